#include "isobrick/viewer/render/layer_pass.h"

#include <algorithm>
#include <array>
#include <glm/vec2.hpp>
#include <string>

#include "isobrick/viewer/render/scene_shaders.h"

namespace isobrick {
namespace {

constexpr std::int64_t kHeadBytes = sizeof(std::uint32_t);  // of a pixel
constexpr std::int64_t kMostHeads = 1 << 22;                // pixels of a band
constexpr GLuint kHeadsBinding = 1, kLayersBinding = 2;

}  // namespace

LayerPass::LayerPass(GlDevice& device)
    : device_(device),
      most_bytes_(std::min(kMostBytes, device.limits().storage_block_bytes)),
      most_layers_((most_bytes_ - kLayerHeadBytes) / kLayerBytes),
      empty_array_(GlVertexArray::make()) {}

std::int64_t LayerPass::bytes() const {
  if (kept_layers_ == 0) return 0;
  constexpr std::int64_t kSampleBytes = sizeof(float);
  return kept_heads_ * kHeadBytes + kLayerHeadBytes + kept_layers_ * kLayerBytes +
         kSampleBytes * samples_ * width_ * height_;
}

void LayerPass::release() {
  bands_ = 0;
  if (width_ == 0 && kept_layers_ == 0) return;
  heads_ = {};
  layers_ = {};
  count_ = {};
  depths_ = {};
  depth_frame_ = {};
  kept_heads_ = kept_layers_ = 0;
  width_ = height_ = 0;
}

void LayerPass::draw(const GlTargets& targets, const BufferBox& pixels,
                     const std::function<void(const BufferBox&)>& drawFragments) {
  if (*program_ == 0) program_ = makeLayersProgram();
  keepOpaqueDepth(targets);
  bands_ = 0;
  glEnable(GL_SCISSOR_TEST);
  int rows = static_cast<int>(std::clamp<std::int64_t>(
      std::min(kMostHeads, most_bytes_ / kHeadBytes) / (pixels.right - pixels.left), 1,
      pixels.top - pixels.bottom));
  for (band_ = pixels; band_.bottom < pixels.top;) {
    band_.top = std::min(band_.bottom + rows, pixels.top);
    const int height = band_.top - band_.bottom;
    in_bands_ = height < pixels.top - pixels.bottom;
    const std::int64_t layers = fillLists(targets, drawFragments);
    if (layers > kept_layers_ && kept_layers_ < most_layers_) {
      reserve(layers + layers / 4, 0);  // the next frame has about as many
      continue;
    }
    // In one row they are given up: the picture lacks what was drawn last.
    if (layers > kept_layers_ && height > 1) {
      rows =
          static_cast<int>(std::clamp<std::int64_t>(height * kept_layers_ / layers, 1, height / 2));
      continue;
    }
    composite(targets);
    ++bands_;
    band_.bottom = band_.top;
  }
  glDisable(GL_SCISSOR_TEST);
}

void LayerPass::use(const GlProgram& program) const {
  setUniform(program, "list_corner", glm::ivec2(band_.left, band_.bottom));
  setUniform(program, "list_size", glm::ivec2(band_.right - band_.left, band_.top - band_.bottom));
  setUniform(program, "list_capacity", static_cast<unsigned>(kept_layers_));
}

// A shader may not read the depth that it writes.
void LayerPass::keepOpaqueDepth(const GlTargets& targets) {
  if (width_ != targets.width() || height_ != targets.height()) {
    depths_ = GlTexture::make(GLenum{GL_TEXTURE_2D_MULTISAMPLE});
    glTextureStorage2DMultisample(*depths_, targets.samples(), GL_DEPTH_COMPONENT32F,
                                  targets.width(), targets.height(), GL_TRUE);
    depth_frame_ = GlFramebuffer::make();
    glNamedFramebufferTexture(*depth_frame_, GL_DEPTH_ATTACHMENT, *depths_, 0);
    glNamedFramebufferDrawBuffer(*depth_frame_, GL_NONE);
    width_ = targets.width();
    height_ = targets.height();
    samples_ = targets.samples();
    checkMemory();
  }
  glBlitNamedFramebuffer(targets.sampledFrame(), *depth_frame_, 0, 0, width_, height_, 0, 0, width_,
                         height_, GL_DEPTH_BUFFER_BIT, GL_NEAREST);
}

void LayerPass::reserve(std::int64_t layers, std::int64_t heads) {
  const auto make = [&](GlBuffer& buffer, std::int64_t bytes, GLbitfield flags) {
    buffer = GlBuffer::make();
    glNamedBufferStorage(*buffer, static_cast<GLsizeiptr>(bytes), nullptr, flags);
  };
  // A driver may move a buffer that is read back to the processor's memory, so the length of the
  // lists is read from a buffer of its own.
  if (*count_ == 0) make(count_, kHeadBytes, GL_CLIENT_STORAGE_BIT);
  if (heads > kept_heads_) {
    make(heads_, heads * kHeadBytes, 0);
    kept_heads_ = heads;
  }
  layers = std::min(layers, most_layers_);
  if (layers > kept_layers_) {
    make(layers_, kLayerHeadBytes + layers * kLayerBytes, 0);
    kept_layers_ = layers;
  }
  checkMemory();
}

void LayerPass::checkMemory() {
  try {
    device_.checkErrors("cannot render: " + device_.name() +
                        " has no memory left for what is seen through; choose a smaller width or "
                        "height, or opaque surfaces");
  } catch (...) {
    release();
    throw;
  }
}

// Returns how many there would be, if the lists had room for all.
std::uint32_t LayerPass::fillLists(const GlTargets& targets,
                                   const std::function<void(const BufferBox&)>& drawFragments) {
  const int width = band_.right - band_.left, height = band_.top - band_.bottom;
  const std::int64_t pixels = std::int64_t{width} * height;
  // The lists are cleared while those of before may still be read; Mesa 22 does not wait by itself.
  composited_.wait();
  reserve(pixels, pixels);
  const auto clear = [](const GlBuffer& buffer, std::int64_t bytes) {
    glClearNamedBufferSubData(*buffer, GL_R32UI, 0, static_cast<GLsizeiptr>(bytes), GL_RED_INTEGER,
                              GL_UNSIGNED_INT, nullptr);
  };
  clear(heads_, pixels * kHeadBytes);
  clear(layers_, kLayerHeadBytes);
  glBindBufferBase(GL_SHADER_STORAGE_BUFFER, kHeadsBinding, *heads_);
  glBindBufferBase(GL_SHADER_STORAGE_BUFFER, kLayersBinding, *layers_);
  glBindFramebuffer(GL_FRAMEBUFFER, targets.sampledFrame());
  glScissor(band_.left, band_.bottom, width, height);
  glEnable(GL_DEPTH_TEST);
  glDisable(GL_BLEND);
  glDepthMask(GL_FALSE);
  glColorMask(GL_FALSE, GL_FALSE, GL_FALSE, GL_FALSE);
  drawFragments(band_);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  glDepthMask(GL_TRUE);
  glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT | GL_BUFFER_UPDATE_BARRIER_BIT);
  std::uint32_t layers = 0;
  glCopyNamedBufferSubData(*layers_, *count_, 0, 0, sizeof layers);
  glGetNamedBufferSubData(*count_, 0, sizeof layers, &layers);
  return layers;
}

void LayerPass::composite(const GlTargets& targets) {
  glBindFramebuffer(GL_FRAMEBUFFER, targets.sampledFrame());
  glViewport(0, 0, width_, height_);
  glDepthFunc(GL_GEQUAL);  // a sample without a surface keeps its depth
  glEnable(GL_BLEND);
  glBlendFunc(GL_ONE, GL_ONE_MINUS_SRC_ALPHA);
  glBindTextureUnit(0, *depths_);
  glBindVertexArray(*empty_array_);
  glUseProgram(*program_);
  use(program_);
  for (int sample = 0; sample < targets.samples(); ++sample) {
    glm::vec2 place(0.5f);
    glGetMultisamplefv(GL_SAMPLE_POSITION, static_cast<GLuint>(sample), &place[0]);
    setUniform(program_, ("sample_places[" + std::to_string(sample) + "]").c_str(), place - 0.5f);
  }
  glDrawArrays(GL_TRIANGLES, 0, 3);
  composited_ = GlFence::make();
  glDisable(GL_BLEND);
  glDepthFunc(GL_GREATER);
}

}  // namespace isobrick
