// The user's input as plain data: from a window, or from a script.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>

namespace isobrick {

enum class MouseButton { kLeft, kMiddle, kRight };

// The keys that the viewer uses, beside text.
enum class Key {
  kNone,
  kA,
  kB,
  kC,
  kD,
  kE,
  kF,
  kG,
  kH,
  kI,
  kJ,
  kK,
  kL,
  kM,
  kN,
  kO,
  kP,
  kQ,
  kR,
  kS,
  kT,
  kU,
  kV,
  kW,
  kX,
  kY,
  kZ,
  kPad1,
  kPad3,
  kPad5,
  kPad7,
  kLeft,
  kRight,
  kUp,
  kDown,
  kTab,
  kEscape,
  kEnter,
  kBackspace,
  kDelete,
  kHome,
  kEnd,
  kF12,
};
inline constexpr std::array<std::string_view, 43> kKeyNames{
    "",   "A",    "B",   "C",      "D",     "E",         "F",      "G",    "H",    "I",    "J",
    "K",  "L",    "M",   "N",      "O",     "P",         "Q",      "R",    "S",    "T",    "U",
    "V",  "W",    "X",   "Y",      "Z",     "PAD1",      "PAD3",   "PAD5", "PAD7", "LEFT", "RIGHT",
    "UP", "DOWN", "TAB", "ESCAPE", "ENTER", "BACKSPACE", "DELETE", "HOME", "END",  "F12"};
inline constexpr std::size_t kKeyCount = kKeyNames.size();
static_assert(static_cast<std::size_t>(Key::kF12) + 1 == kKeyCount);

std::optional<Key> keyNamed(std::string_view name);

// The letter of a key in the user's layout. `name`: the text on the key there, UTF-8, may be empty;
// `us_letter`: that of a US keyboard in this place, 'A' .. 'Z', or 0. It counts if the layout has
// no Latin letters (Greek, Cyrillic) or says nothing. kNone: the key has no letter.
Key letterKey(std::string_view name, char us_letter);

struct InputEvent {
  enum class Kind {
    kMove,        // the cursor is at x, y
    kPress,       // of `button`
    kRelease,     // of `button`
    kWheel,       // by `amount` notches away from the user, and `across` to the right
    kKeyPress,    // of `key`; repeats of a held key too
    kKeyRelease,  // of `key`
    kText,        // the character `character`
    kResize,      // of the picture: to x by y pixels, 0 while the window is minimised
    kClose,       // the window is to go
    kOpen,        // `path` is to be opened: it was dropped on the window, or chosen
    kRefresh,     // the window's picture was damaged
  };

  Kind kind = Kind::kMove;
  double x = 0.0;  // pixels from the left
  double y = 0.0;  // pixels from the top
  MouseButton button = MouseButton::kLeft;
  Key key = Key::kNone;
  double amount = 0.0;
  double across = 0.0;
  unsigned character = 0;
  bool shift = false, control = false;
  bool repeated = false;  // a key that is held
  int clicks = 0;         // of a press: 2 if its sender recognises a double click
  std::string path;       // bytes, as the system has them
  // When it was noticed, by the caller's clock; none: now. It may have come up to `waited` seconds
  // earlier, while nobody looked.
  std::optional<double> seconds = {};
  double waited = 0.0;

  static InputEvent resized(double width, double height) {
    InputEvent event;
    event.kind = Kind::kResize;
    event.x = width;
    event.y = height;
    return event;
  }

  bool operator==(const InputEvent&) const = default;
};

}  // namespace isobrick
