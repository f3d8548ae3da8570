// The instruction sets that kernels choose from.
#pragma once

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <cstdint>

namespace isobrick::test {

// Calls `f` once for every instruction set of the machine, the portable one included, with kernels
// that choose it; then they choose the best again.
template <typename F>
void onEveryTarget(F&& f) {
  for (std::int64_t left = hwy::SupportedTargets(); left != 0; left &= left - 1) {
    const std::int64_t target = left & -left;
    hwy::SetSupportedTargetsForTest(target);
    SCOPED_TRACE(hwy::TargetName(target));
    f();
    hwy::SetSupportedTargetsForTest(0);
  }
}

}  // namespace isobrick::test
