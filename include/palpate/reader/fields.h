#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <type_traits>
#include <utility>

#include "palpate/base/result.h"

/// Serialisation of plain fields over a pipe between two processes of one machine: numbers in native byte
/// order; a text is u32 n and n bytes.
namespace palpate::reader {

class ByteTarget {
 public:
  virtual ~ByteTarget() = default;
  virtual bool write(std::span<const std::byte> bytes) = 0;
};

class ByteSource {
 public:
  virtual ~ByteSource() = default;
  /// Fills `bytes` completely. Errors: depend on the source.
  virtual Result<void> read(std::span<std::byte> bytes) = 0;
};

class Sender {
 public:
  explicit Sender(ByteTarget& target) : target_(target) {}
  /// False once a write has failed; nothing more is sent then.
  bool ok() const { return ok_; }

  template <class Plain>
  requires std::is_arithmetic_v<Plain>
  void put(const Plain& value) { put_bytes(std::as_bytes(std::span(&value, 1))); }
  void put(const std::string& text) {
    put(static_cast<std::uint32_t>(text.size()));
    put_bytes(std::as_bytes(std::span(text)));
  }

 private:
  void put_bytes(std::span<const std::byte> bytes) { ok_ = ok_ && target_.write(bytes); }

  ByteTarget& target_;
  bool ok_ = true;
};

/// Deserialises fields; after the first failure values are left unchanged and error() returns the reason.
class Receiver {
 public:
  /// Default limit for the length of a text; bytes.
  static constexpr std::size_t kMaxText_bytes = 4096;

  /// @param complaint  prefix of the errors that fail() reports
  Receiver(ByteSource& source, std::string complaint) : source_(source), complaint_(std::move(complaint)) {}
  bool ok() const { return !error_.has_value(); }
  const Error& error() const { return *error_; }

  template <class Plain>
  requires std::is_arithmetic_v<Plain>
  void get(Plain& value) {
    Plain read{};
    get_bytes(std::as_writable_bytes(std::span(&read, 1)));
    if (ok()) value = read;
  }
  void get(bool& value) {
    std::uint8_t byte = 0;
    get(byte);
    value = byte != 0;
  }
  void get(std::string& text, std::size_t largest = kMaxText_bytes) {
    std::uint32_t size = 0;
    get(size);
    if (size > largest) fail("one of its strings is too long");
    if (!ok()) return;
    text.resize(size);
    get_bytes(std::as_writable_bytes(std::span(text)));
  }
  void get_bytes(std::span<std::byte> bytes) {
    if (!ok()) return;
    if (auto read = source_.read(bytes); !read) error_ = read.error();
  }
  void fail(const std::string& what) {
    if (ok()) error_ = Error{ErrorKind::kBadInput, complaint_ + what, "", ""};
  }

 private:
  ByteSource& source_;
  std::string complaint_;
  std::optional<Error> error_;
};

}  // namespace palpate::reader
