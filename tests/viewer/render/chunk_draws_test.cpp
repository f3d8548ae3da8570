// The commands of chunks, as a card gets them: whole, and not in the parts of a rasteriser in
// software.
#include "isobrick/viewer/render/chunk_draws.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "tests/support/gl_test.h"

namespace isobrick {
namespace {

// While it lives, draw calls draw nothing, and their commands are kept.
class CommandsOfDraws {
 public:
  struct Command {
    GLuint count, instances, first_index;
    GLint base_vertex;
    GLuint base_instance;
  };

  CommandsOfDraws() : before_(epoxy_glMultiDrawElementsIndirect) {
    draws_ = this;
    epoxy_glMultiDrawElementsIndirect = [](GLenum, GLenum, const void* first, GLsizei count,
                                           GLsizei) {
      GLint buffer = 0;
      glGetIntegerv(GL_DRAW_INDIRECT_BUFFER_BINDING, &buffer);
      std::vector<Command> commands(static_cast<std::size_t>(count));
      glGetNamedBufferSubData(static_cast<GLuint>(buffer), reinterpret_cast<GLintptr>(first),
                              static_cast<GLsizeiptr>(commands.size() * sizeof(Command)),
                              commands.data());
      draws_->commands_.insert(draws_->commands_.end(), commands.begin(), commands.end());
    };
  }
  ~CommandsOfDraws() { epoxy_glMultiDrawElementsIndirect = before_; }
  CommandsOfDraws(const CommandsOfDraws&) = delete;
  CommandsOfDraws& operator=(const CommandsOfDraws&) = delete;

  const std::vector<Command>& commands() const { return commands_; }

 private:
  inline static CommandsOfDraws* draws_ = nullptr;
  decltype(epoxy_glMultiDrawElementsIndirect) before_;
  std::vector<Command> commands_;
};

class ChunkDrawsTest : public test::GlTest {
 protected:
  void setUp() override {}
};

// Each index once, whether the flight is bounded or not; transition cells in a command of their
// own.
TEST_F(ChunkDrawsTest, EveryTriangleIsDrawnOnce) {
  GlDevice device;
  GlChunks chunks(device, false);
  SurfaceChunk chunk;
  chunk.vertices.resize(3);
  chunk.vertices[1].position = {1.0f, 0.0f, 0.0f};
  chunk.vertices[2].position = {0.0f, 0.0f, 1.0f};
  for (int i = 0; i < 9000; ++i) chunk.triangles.insert(chunk.triangles.end(), {0, 1, 2});
  chunk.transition_indices = 3 * 4000;
  boundChunk(chunk);
  SceneFrame frame;
  frame.width = frame.height = 64;
  frame.camera.eye = {0.0, -10.0, 0.0};
  frame.bounds = {glm::dvec3(-1.0), glm::dvec3(1.0)};
  frame.transition_color = glm::vec3(1.0f);
  frame.chunks = {chunks.upload(chunk)};
  const SceneView view(frame);
  for (const bool bounds_flight : {false, true}) {
    ChunkDraws draws(bounds_flight);
    draws.collect(chunks, view, view.planesDrawn());
    const CommandsOfDraws drawn;
    draws.draw(chunks, 0, false);
    if (!bounds_flight) {
      EXPECT_EQ(drawn.commands().size(), 2u);
    }
    std::uint32_t end = chunks.at(frame.chunks[0]).firstIndex();
    for (const CommandsOfDraws::Command& command : drawn.commands()) {
      EXPECT_EQ(command.first_index, end);
      EXPECT_EQ(command.count % 3, 0u);
      end = command.first_index + command.count;
    }
    EXPECT_EQ(end, chunks.at(frame.chunks[0]).firstIndex() + chunk.triangles.size());
  }
}

}  // namespace
}  // namespace isobrick
