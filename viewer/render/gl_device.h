// The card behind a context: its name, and the faults that it reports.
#pragma once

#include <optional>
#include <string>

#include "isobrick/viewer/render/gl_limits.h"

namespace isobrick {

// Made and used on the thread on which its context is current.
class GlDevice {
 public:
  // With the limits that the context has, or with these. Throws Error if they are too narrow.
  explicit GlDevice(const std::optional<GlLimits>& limits = std::nullopt);

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
  // For instance "4.5 (Core Profile) Mesa 22.3.6", and "Mesa/X.org".
  const std::string& version() const { return version_; }
  const std::string& vendor() const { return vendor_; }
  // The processor draws.
  bool isSoftware() const { return is_software_; }
  const GlLimits& limits() const { return limits_; }

 private:
  std::string name_, version_, vendor_;
  GlLimits limits_;
  bool is_software_ = false;
  bool is_lost_ = false;
};

}  // namespace isobrick
