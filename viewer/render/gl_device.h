// The card behind a context: its name, and the faults that it reports.
#pragma once

#include <string>

namespace isobrick {

// Made and used on the thread on which its context is current.
class GlDevice {
 public:
  GlDevice();

  // Errors of earlier calls are none of the next ones, but for a loss, which it throws as
  // RendererLost.
  void forgetErrors();
  // Throws what the calls since forgetErrors() reported: RendererLost, NoGraphicsMemory with these
  // words, or Error.
  void checkErrors(const std::string& if_no_memory);
  // The driver was reset. Stays true.
  bool isLost();

  // For instance "llvmpipe (LLVM 15.0.6, 256 bits)".
  const std::string& name() const { return name_; }
  // The processor draws.
  bool isSoftware() const { return is_software_; }

 private:
  std::string name_;
  bool is_software_ = false;
  bool is_lost_ = false;
};

}  // namespace isobrick
