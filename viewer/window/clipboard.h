// The text that programs of the desktop share.
#pragma once

#include <string>

namespace isobrick {

class Clipboard {
 public:
  virtual ~Clipboard() = default;

  // UTF-8; empty if there is no text.
  virtual std::string clipboardText() = 0;
  virtual void setClipboardText(const std::string& text) = 0;
};

}  // namespace isobrick
