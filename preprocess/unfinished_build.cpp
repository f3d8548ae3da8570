#include "isobrick/preprocess/unfinished_build.h"

#include <new>
#include <string>
#include <vector>

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

enum class InputState { kAsItWas, kChanged, kUnknown };

// Unknown if the user cancelled the check.
InputState stateOf(InputWatch& input) {
  try {
    input.checkContent();
    return InputState::kAsItWas;
  } catch (const Cancelled&) {
    return InputState::kUnknown;
  } catch (const Error&) {
    return InputState::kChanged;
  }
}

bool keepForResume(const UnfinishedBuild& build) {
  PyramidWriter& writer = build.writer;
  if (!build.options.keep_unfinished || writer.bricksWritten() == 0) return false;
  try {
    writer.flush();
  } catch (const Error&) {  // the disk is full: the last bricks are made again
  }
  writer.keepForResume();
  return true;
}

std::string whatIsKept(const UnfinishedBuild& build) {
  const auto percent = static_cast<int>(100 * static_cast<double>(build.writer.bricksWritten()) /
                                        static_cast<double>(build.bricks));
  return std::to_string(percent) + " % of the bricks are kept in '" + build.writer.temporaryPath() +
         "'";
}

[[noreturn]] void throwInterrupted(const UnfinishedBuild& build) {
  if (!keepForResume(build)) throw Cancelled();
  throw Cancelled("interrupted; " + whatIsKept(build), {.path = build.writer.temporaryPath()},
                  {Remedy::kResume});
}

// The same error, of a build that can go on.
ResumableError resumable(const UnfinishedBuild& build, const Error& error,
                         const std::string& more = "") {
  std::vector<Remedy> remedies = error.remedies();
  remedies.push_back(Remedy::kResume);
  return ResumableError(error.what() + more + "; " + whatIsKept(build), error.place(), remedies);
}

}  // namespace

void throwUnfinished(const UnfinishedBuild& build) {
  try {
    throw;
  } catch (const Cancelled&) {
    throwInterrupted(build);
  } catch (const ResumableError& error) {
    if (!keepForResume(build)) throw;
    throw resumable(build, error);
  } catch (const Error& error) {
    // A file that is written or moved while it is read may look damaged.
    const InputState state = stateOf(build.input);
    if (state == InputState::kUnknown) throwInterrupted(build);
    if (state == InputState::kAsItWas || !keepForResume(build)) throw;
    throw resumable(build, error, "; it changed while it was read");
  } catch (const std::bad_alloc&) {
    if (!keepForResume(build)) throw;
    const std::string& source = build.info.source;
    throw resumable(build, Error("not enough memory for '" + source + "'", {.path = source},
                                 {Remedy::kUseLessMemory}));
  }
}

}  // namespace isobrick
