#pragma once

#include <optional>
#include <string>
#include <utility>
#include <variant>

#include "palpate/base/check.h"

namespace palpate {

/// Category of an Error; an application maps it to its exit code.
enum class ErrorKind {
  kBadInput,     ///< A file or a setting that cannot be used as it is.
  kUsage,        ///< An invalid command line.
  kOutput,       ///< A result could not be written: full disk, missing or read-only folder.
  kUnavailable,  ///< Something external is missing: network, data set, device.
  kInterrupted,  ///< The user cancelled.
};

/// Error for the user: what is wrong, where, and how to correct it.
struct Error {
  ErrorKind kind = ErrorKind::kBadInput;
  std::string what;    ///< One sentence without a full stop, e.g. "the voxel data end after 52 of 113
                       ///< slices".
  std::string where;   ///< File, or file:line, or option; may be empty.
  std::string remedy;  ///< Remedy for the user; may be empty.

  /// Text "where: what\n  remedy", as every verb prints it.
  std::string message() const {
    std::string text = where.empty() ? what : where + ": " + what;
    if (!remedy.empty()) text += "\n  " + remedy;
    return text;
  }
};

/// A value or an Error, never empty. Accessing the alternative that is not present is a bug and aborts.
template <class T>
class [[nodiscard]] Result {
 public:
  Result(T value) : content_(std::in_place_index<0>, std::move(value)) {}
  Result(Error error) : content_(std::in_place_index<1>, std::move(error)) {}

  bool ok() const { return content_.index() == 0; }
  explicit operator bool() const { return ok(); }

  T& value() & {
    PALPATE_CHECK(ok());
    return std::get<0>(content_);
  }
  const T& value() const& {
    PALPATE_CHECK(ok());
    return std::get<0>(content_);
  }
  T&& value() && {
    PALPATE_CHECK(ok());
    return std::get<0>(std::move(content_));
  }
  const Error& error() const {
    PALPATE_CHECK(!ok());
    return std::get<1>(content_);
  }

  T& operator*() & { return value(); }
  const T& operator*() const& { return value(); }
  T&& operator*() && { return std::move(*this).value(); }
  T* operator->() { return &value(); }
  const T* operator->() const { return &value(); }

 private:
  std::variant<T, Error> content_;
};

/// Success or an Error.
template <>
class [[nodiscard]] Result<void> {
 public:
  Result() = default;
  Result(Error error) : error_(std::move(error)) {}

  bool ok() const { return !error_.has_value(); }
  explicit operator bool() const { return ok(); }
  const Error& error() const {
    PALPATE_CHECK(!ok());
    return *error_;
  }

 private:
  std::optional<Error> error_;
};

}  // namespace palpate
