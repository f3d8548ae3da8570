#include "isobrick/storage/checksum.h"

#define XXH_INLINE_ALL
#include <xxhash.h>

namespace isobrick {

std::uint64_t checksum64(const void* data, std::size_t bytes, std::uint64_t seed) {
  return XXH3_64bits_withSeed(data, bytes, seed);
}

bool isChecksum([[maybe_unused]] std::uint64_t computed, [[maybe_unused]] std::uint64_t stated) {
#ifdef FUZZING_BUILD_MODE_UNSAFE_FOR_PRODUCTION
  return true;
#else
  return computed == stated;
#endif
}

struct RunningChecksum::State {
  XXH3_state_t hash;
};

RunningChecksum::RunningChecksum() : state_(std::make_unique<State>()) {
  XXH3_64bits_reset(&state_->hash);
}
RunningChecksum::~RunningChecksum() = default;

void RunningChecksum::add(const void* data, std::size_t bytes) {
  XXH3_64bits_update(&state_->hash, data, bytes);
}
std::uint64_t RunningChecksum::value() const { return XXH3_64bits_digest(&state_->hash); }

}  // namespace isobrick
