#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <new>
#include <stdexcept>
#include <string>
#include <type_traits>

#include "palpate.h"
#include "palpate/base/progress.h"
#include "palpate/base/result.h"

/// Boundary between C and C++: every function of palpate.h runs its work in guarded(), so that no exception
/// and no unchecked argument passes.
namespace palpate::c {

/// Stores the reason for plp_last_error() of this thread; a long text is cut. Never throws.
void set_last_error(const char* text) noexcept;
/// Stores a reason and returns the status.
plp_status fail(plp_status status, const std::string& what);
plp_status fail(const Error& error);

/// Progress of long work, which the flag of the calling thread (plp_set_cancel_flag) cancels.
Progress cancellable();

/// Runs `work`, which returns a plp_status; exceptions become a status with a reason.
template <class Work>
plp_status guarded(const Work& work) noexcept {
  try {
    return work();
  } catch (const std::bad_alloc&) {
    set_last_error("not enough memory");
    return PLP_OUT_OF_MEMORY;
  } catch (const std::length_error&) {
    set_last_error("not enough memory");
    return PLP_OUT_OF_MEMORY;
  } catch (const std::exception& error) {
    set_last_error(error.what());
    return PLP_INTERNAL;
  } catch (...) {
    set_last_error("unknown exception");
    return PLP_INTERNAL;
  }
}

/// First member of every handle: the handle's type, and none after destruction.
enum class Tag : std::uint32_t {
  kNone = 0,
  kModel = 0x706c704d,
  kSession = 0x706c7053,
  kRun = 0x706c7052,
  kLoop = 0x706c704c,
  kRecording = 0x706c7048,
};

/// Whether a pointer is a live handle of its type; otherwise stores the reason.
template <class Handle>
bool is_handle(const Handle* handle) {
  Tag tag = Tag::kNone;
  if (handle != nullptr) std::memcpy(&tag, static_cast<const void*>(handle), sizeof tag);
  if (tag == Handle::kTag) return true;
  set_last_error(handle == nullptr ? "a handle is null"
                                   : "a handle is of another type, or has been destroyed");
  return false;
}

/// Greatest size that a struct may claim to have, bytes.
inline constexpr std::uint32_t kMaxStructBytes = 1u << 14;

/// Whether `size` can be that of a struct of which this library knows `known` bytes; otherwise stores the
/// reason.
bool is_size(std::uint32_t size, std::size_t known);

/// Reads a struct that its caller has filled. Members behind those that this library knows must be zero: they
/// would be ignored.
template <class Struct>
bool read(const void* supplied, Struct& value) {
  if (supplied == nullptr) return set_last_error("a struct is null"), false;
  std::uint32_t size = 0;
  std::memcpy(&size, supplied, sizeof size);
  if (!is_size(size, sizeof(Struct))) return false;
  std::memcpy(static_cast<void*>(&value), supplied, sizeof value);
  const auto* bytes = static_cast<const unsigned char*>(supplied);
  for (std::size_t n = sizeof(Struct); n < size; ++n)
    if (bytes[n] != 0)
      return set_last_error("a struct has a member that this version of the library does not know"), false;
  return true;
}

/// Writes a struct for its caller, who has set the size.
template <class Struct>
bool write(Struct value, Struct* to) {
  if (to == nullptr) return set_last_error("a struct to fill is null"), false;
  const std::uint32_t size = to->size;
  if (!is_size(size, sizeof(Struct))) return false;
  std::memset(static_cast<void*>(to), 0, size);
  value.size = size;
  std::memcpy(static_cast<void*>(to), &value, sizeof value);
  return true;
}

/// Array of structs of one size, that of the first.
template <class Struct>
class Elements {
  using Bytes = std::conditional_t<std::is_const_v<Struct>, const unsigned char, unsigned char>;

 public:
  /// Null is an empty array. Check ok() before any other call.
  explicit Elements(Struct* first) : first_(reinterpret_cast<Bytes*>(first)) {
    if (first != nullptr) std::memcpy(&size_, first_, sizeof size_);
  }
  bool ok() const { return first_ == nullptr || is_size(size_, sizeof(Struct)); }
  bool empty() const { return first_ == nullptr; }
  Struct* operator[](std::size_t n) const { return reinterpret_cast<Struct*>(first_ + n * size_); }
  /// Writes element n, whose own size need not be set.
  void put(std::size_t n, std::remove_const_t<Struct> value) const {
    Bytes* const to = first_ + n * size_;
    std::memset(to, 0, size_);
    value.size = size_;
    std::memcpy(to, &value, sizeof value);
  }

 private:
  Bytes* first_;
  std::uint32_t size_ = 0;
};

}  // namespace palpate::c
