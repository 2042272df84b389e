#include "c/guard.h"

#include <algorithm>
#include <array>
#include <atomic>

namespace palpate::c {
namespace {

constexpr std::size_t kMaxReason = 2048;
thread_local std::array<char, kMaxReason> last_error{};

// the host's cancel flag, a byte, is read as an atomic bool
static_assert(sizeof(std::atomic<bool>) == 1 && std::atomic<bool>::is_always_lock_free);
thread_local const std::atomic<bool>* cancel_flag = nullptr;

plp_status status_of(ErrorKind kind) {
  switch (kind) {
    case ErrorKind::kBadInput:
      return PLP_BAD_INPUT;
    case ErrorKind::kUsage:
      return PLP_USAGE;
    case ErrorKind::kOutput:
      return PLP_OUTPUT;
    case ErrorKind::kUnavailable:
      return PLP_UNAVAILABLE;
    case ErrorKind::kInterrupted:
      return PLP_INTERRUPTED;
  }
  return PLP_INTERNAL;
}

}  // namespace

void set_last_error(const char* text) noexcept {
  const std::size_t length = std::min(std::strlen(text), kMaxReason - 1);
  std::memcpy(last_error.data(), text, length);
  last_error[length] = '\0';
}

plp_status fail(plp_status status, const std::string& what) {
  set_last_error(what.c_str());
  return status;
}

plp_status fail(const Error& error) {
  return fail(status_of(error.kind), error.message());
}

Progress cancellable() {
  return {nullptr, cancel_flag};
}

bool is_size(std::uint32_t size, std::size_t known) {
  if (size >= known && size <= kMaxStructBytes) return true;
  set_last_error("a struct does not begin with its size: call its plp_..._init() first");
  return false;
}

}  // namespace palpate::c

void plp_set_cancel_flag(const uint8_t* flag) {
  palpate::c::cancel_flag = reinterpret_cast<const std::atomic<bool>*>(flag);
}

const char* plp_last_error() {
  return palpate::c::last_error.data();
}
