#include "isobrick/viewer/render/gl_debug_output.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <string_view>
#include <utility>

namespace isobrick {
namespace {

const char* nameOfType(GLenum type) {
  switch (type) {
    case GL_DEBUG_TYPE_ERROR:
      return "error";
    case GL_DEBUG_TYPE_DEPRECATED_BEHAVIOR:
      return "deprecated";
    case GL_DEBUG_TYPE_UNDEFINED_BEHAVIOR:
      return "undefined";
    case GL_DEBUG_TYPE_PORTABILITY:
      return "portability";
    case GL_DEBUG_TYPE_PERFORMANCE:
      return "performance";
    default:
      return "other";
  }
}

const char* nameOfSeverity(GLenum severity) {
  switch (severity) {
    case GL_DEBUG_SEVERITY_HIGH:
      return "high";
    case GL_DEBUG_SEVERITY_MEDIUM:
      return "medium";
    case GL_DEBUG_SEVERITY_LOW:
      return "low";
    default:
      return "notification";
  }
}

// Contexts of several threads share the listener.
struct SharedListener {
  std::mutex mutex;
  DriverListener listener;
};
SharedListener& sharedListener() {
  static SharedListener shared;
  return shared;
}

bool environmentWantsMessages() {
  const char* const value = std::getenv("ISOBRICK_GL_DEBUG");
  return value != nullptr && std::string_view(value) != "" && std::string_view(value) != "0";
}

void GLAPIENTRY onDriverMessage(GLenum, GLenum type, GLuint, GLenum severity, GLsizei length,
                                const GLchar* text, const void*) {
  DriverMessage message{
      type, severity,
      length < 0 ? std::string(text) : std::string(text, static_cast<std::size_t>(length))};
  if (!message.isComplaint()) return;
  while (!message.text.empty() && (message.text.back() == '\n' || message.text.back() == '\0'))
    message.text.pop_back();
  std::replace(message.text.begin(), message.text.end(), '\n', ' ');
  DriverListener listener;
  {
    const std::lock_guard lock(sharedListener().mutex);
    listener = sharedListener().listener;
  }
  if (listener)
    listener(message);
  else
    std::fprintf(stderr, "isobrick: the OpenGL driver says (%s)\n", message.line().c_str());
}

}  // namespace

bool DriverMessage::isComplaint() const {
  return type == GL_DEBUG_TYPE_ERROR || type == GL_DEBUG_TYPE_UNDEFINED_BEHAVIOR ||
         type == GL_DEBUG_TYPE_DEPRECATED_BEHAVIOR || severity == GL_DEBUG_SEVERITY_HIGH ||
         severity == GL_DEBUG_SEVERITY_MEDIUM;
}

std::string DriverMessage::line() const {
  return std::string(nameOfType(type)) + ", " + nameOfSeverity(severity) + ": " + text;
}

void listenToDrivers(DriverListener listener) {
  const std::lock_guard lock(sharedListener().mutex);
  sharedListener().listener = std::move(listener);
}

bool driversAreHeard() {
  const std::lock_guard lock(sharedListener().mutex);
  return sharedListener().listener != nullptr || environmentWantsMessages();
}

void hearCurrentDriver() {
  if (!driversAreHeard()) return;
  glEnable(GL_DEBUG_OUTPUT);
  glEnable(GL_DEBUG_OUTPUT_SYNCHRONOUS);
  glDebugMessageControl(GL_DONT_CARE, GL_DONT_CARE, GL_DONT_CARE, 0, nullptr, GL_TRUE);
  glDebugMessageCallback(onDriverMessage, nullptr);
}

}  // namespace isobrick
