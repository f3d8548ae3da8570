#include "isobrick/viewer/window/gl_window.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <string>
#include <utility>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/render/gl_debug_output.h"
#include "isobrick/viewer/state/interaction.h"
#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

namespace isobrick {
namespace {

[[noreturn]] void refuse() {
  const char* said = nullptr;
  glfwGetError(&said);
  std::string why = said == nullptr ? "no reason was given" : said;
  std::replace(why.begin(), why.end(), '\n', ' ');
  throw Error("cannot open a window with OpenGL 4.5 (" + why +
              "); 'isobrick render' draws pictures without one, and 'isobrick view --offscreen' "
              "runs scripts");
}

struct KeyPair {
  int glfw;
  Key key;
};
constexpr std::array kOtherKeys{
    KeyPair{GLFW_KEY_KP_1, Key::kPad1},
    KeyPair{GLFW_KEY_KP_3, Key::kPad3},
    KeyPair{GLFW_KEY_KP_5, Key::kPad5},
    KeyPair{GLFW_KEY_KP_7, Key::kPad7},
    KeyPair{GLFW_KEY_LEFT, Key::kLeft},
    KeyPair{GLFW_KEY_RIGHT, Key::kRight},
    KeyPair{GLFW_KEY_UP, Key::kUp},
    KeyPair{GLFW_KEY_DOWN, Key::kDown},
    KeyPair{GLFW_KEY_TAB, Key::kTab},
    KeyPair{GLFW_KEY_ESCAPE, Key::kEscape},
    KeyPair{GLFW_KEY_ENTER, Key::kEnter},
    KeyPair{GLFW_KEY_KP_ENTER, Key::kEnter},
    KeyPair{GLFW_KEY_BACKSPACE, Key::kBackspace},
    KeyPair{GLFW_KEY_DELETE, Key::kDelete},
    KeyPair{GLFW_KEY_HOME, Key::kHome},
    KeyPair{GLFW_KEY_END, Key::kEnd},
    KeyPair{GLFW_KEY_F12, Key::kF12},
};

// Letters are those of the layout; GLFW counts keys by their places on a US keyboard.
Key keyOf(int glfw, int scancode) {
  const bool is_us_letter = glfw >= GLFW_KEY_A && glfw <= GLFW_KEY_Z;
  const char* const name = glfwGetKeyName(glfw, scancode);
  const Key letter = letterKey(name == nullptr ? "" : name,
                               is_us_letter ? static_cast<char>('A' + glfw - GLFW_KEY_A) : '\0');
  if (letter != Key::kNone) return letter;
  const auto found = std::find_if(kOtherKeys.begin(), kOtherKeys.end(),
                                  [&](const KeyPair& pair) { return pair.glfw == glfw; });
  return found == kOtherKeys.end() ? Key::kNone : found->key;
}

}  // namespace

// GLFW calls these while events are taken; none of them throws.
struct GlWindow::Callbacks {
  static GlWindow& of(GLFWwindow* window) {
    return *static_cast<GlWindow*>(glfwGetWindowUserPointer(window));
  }
  static InputEvent event(GLFWwindow* window, InputEvent::Kind kind) {
    InputEvent result;
    result.kind = kind;
    const auto down = [&](int key) { return glfwGetKey(window, key) == GLFW_PRESS; };
    result.shift = down(GLFW_KEY_LEFT_SHIFT) || down(GLFW_KEY_RIGHT_SHIFT);
    result.control = down(GLFW_KEY_LEFT_CONTROL) || down(GLFW_KEY_RIGHT_CONTROL);
    return result;
  }
  static void push(GLFWwindow* window, const InputEvent& event) {
    of(window).events_.push_back(event);
  }

  // Windows may be counted in other units than their pixels.
  static void onMove(GLFWwindow* window, double x, double y) {
    int width = 1, height = 1, pixels_x = 1, pixels_y = 1;
    glfwGetWindowSize(window, &width, &height);
    glfwGetFramebufferSize(window, &pixels_x, &pixels_y);
    InputEvent moved = event(window, InputEvent::Kind::kMove);
    moved.x = x * pixels_x / std::max(width, 1);
    moved.y = y * pixels_y / std::max(height, 1);
    push(window, moved);
  }
  static void onButton(GLFWwindow* window, int button, int action, int) {
    if (button > GLFW_MOUSE_BUTTON_MIDDLE) return;
    InputEvent pressed =
        event(window, action == GLFW_PRESS ? InputEvent::Kind::kPress : InputEvent::Kind::kRelease);
    pressed.button = button == GLFW_MOUSE_BUTTON_LEFT    ? MouseButton::kLeft
                     : button == GLFW_MOUSE_BUTTON_RIGHT ? MouseButton::kRight
                                                         : MouseButton::kMiddle;
    push(window, pressed);
  }
  static void onWheel(GLFWwindow* window, double x, double y) {
    InputEvent turned = event(window, InputEvent::Kind::kWheel);
    turned.amount = y;
    turned.across = -x;  // GLFW counts to the left
    push(window, turned);
  }
  static void onKey(GLFWwindow* window, int key, int scancode, int action, int) {
    InputEvent pressed = event(window, action == GLFW_RELEASE ? InputEvent::Kind::kKeyRelease
                                                              : InputEvent::Kind::kKeyPress);
    pressed.key = keyOf(key, scancode);
    pressed.repeated = action == GLFW_REPEAT;
    if (pressed.key != Key::kNone) push(window, pressed);
  }
  static void onText(GLFWwindow* window, unsigned character) {
    InputEvent text = event(window, InputEvent::Kind::kText);
    text.character = character;
    push(window, text);
  }
  // Opens the last one of several files.
  static void onDrop(GLFWwindow* window, int count, const char** paths) {
    for (int i = 0; i < count; ++i) {
      InputEvent dropped = event(window, InputEvent::Kind::kOpen);
      dropped.path = paths[i];
      push(window, dropped);
    }
  }
  static void onScale(GLFWwindow* window, float, float) { onRefresh(window); }
  static void onRefresh(GLFWwindow* window) {
    push(window, event(window, InputEvent::Kind::kRefresh));
  }
  static void onSize(GLFWwindow* window, int, int) { of(window).pushSize(); }
  static void onClose(GLFWwindow* window) { push(window, event(window, InputEvent::Kind::kClose)); }
};

GlWindow::GlWindow(int width, int height, const std::string& title) : title_(title) {
#ifdef GLFW_PLATFORM
  // GLFW 3.4 asks for Wayland first, whose library complains on stderr where there is none.
  if (std::getenv("WAYLAND_DISPLAY") == nullptr && std::getenv("WAYLAND_SOCKET") == nullptr)
    glfwInitHint(GLFW_PLATFORM, GLFW_PLATFORM_X11);
#endif
  if (glfwInit() != GLFW_TRUE) refuse();
  try {
    open(width, height);
  } catch (...) {
    close();
    glfwTerminate();
    throw;
  }
}

void GlWindow::renew() {
  if (window_ != nullptr) glfwGetWindowSize(window_, &last_width_, &last_height_);
  close();
  open(std::max(last_width_, 1), std::max(last_height_, 1));
}

void GlWindow::open(int width, int height) {
  glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 4);
  glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 5);
  glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
  glfwWindowHint(GLFW_CONTEXT_ROBUSTNESS, GLFW_LOSE_CONTEXT_ON_RESET);  // and reports it
  glfwWindowHint(GLFW_OPENGL_DEBUG_CONTEXT, driversAreHeard() ? GLFW_TRUE : GLFW_FALSE);
  glfwWindowHint(GLFW_DEPTH_BITS, 0);  // frames have buffers of their own
  glfwWindowHint(GLFW_STENCIL_BITS, 0);
  window_ = glfwCreateWindow(width, height, title_.c_str(), nullptr, nullptr);
  if (window_ == nullptr) refuse();
  glfwMakeContextCurrent(window_);
  glfwSwapInterval(1);
  renderer_ = std::make_unique<GlSceneRenderer>();
  glfwSetWindowUserPointer(window_, this);
  glfwSetCursorPosCallback(window_, Callbacks::onMove);
  glfwSetMouseButtonCallback(window_, Callbacks::onButton);
  glfwSetScrollCallback(window_, Callbacks::onWheel);
  glfwSetKeyCallback(window_, Callbacks::onKey);
  glfwSetCharCallback(window_, Callbacks::onText);
  glfwSetDropCallback(window_, Callbacks::onDrop);
  glfwSetWindowRefreshCallback(window_, Callbacks::onRefresh);
  glfwSetFramebufferSizeCallback(window_, Callbacks::onSize);
  glfwSetWindowContentScaleCallback(window_, Callbacks::onScale);
  glfwSetWindowCloseCallback(window_, Callbacks::onClose);
  pushSize();
}

void GlWindow::close() {
  renderer_.reset();
  if (window_ != nullptr) glfwDestroyWindow(window_);
  window_ = nullptr;
}

GlWindow::~GlWindow() {
  close();
  glfwTerminate();
}

void GlWindow::pushSize() {
  int width = 0, height = 0;
  glfwGetFramebufferSize(window_, &width, &height);
  events_.push_back(InputEvent::resized(width, height));
}

std::vector<InputEvent> GlWindow::takeEvents(double wait_seconds) {
  if (wait_seconds > 0.0 && events_.empty())
    glfwWaitEventsTimeout(wait_seconds);
  else
    glfwPollEvents();
  return std::exchange(events_, {});
}

void GlWindow::resize(int width, int height) {
  if (width > 0 && height > 0) glfwSetWindowSize(window_, width, height);
}

double GlWindow::scale() const {
  float x = 1.0f, y = 1.0f;
  glfwGetWindowContentScale(window_, &x, &y);
  return std::clamp(static_cast<double>(x), 1.0, kMostScale);
}

void GlWindow::setTitle(const std::string& title) {
  title_ = title;
  glfwSetWindowTitle(window_, title_.c_str());
}

std::string GlWindow::clipboardText() {
  const char* const text = glfwGetClipboardString(window_);
  return text == nullptr ? "" : text;
}

void GlWindow::setClipboardText(const std::string& text) {
  glfwSetClipboardString(window_, text.c_str());
}

void GlWindow::show() { glfwSwapBuffers(window_); }

}  // namespace isobrick
