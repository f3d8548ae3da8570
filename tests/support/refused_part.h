// Parts that a pager refuses.
#pragma once

#include <string>

#include "isobrick/storage/brick_pager.h"

namespace isobrick::test {

// The text of the failure; "" if the part came, and then it is in use.
inline std::string whyRefused(BrickPager& pager, std::size_t id) {
  try {
    return pager.acquire(id) == nullptr ? "no bytes" : "";
  } catch (const ReadFailure& failure) {
    return failure.what();
  }
}

}  // namespace isobrick::test
