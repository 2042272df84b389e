#pragma once

#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <optional>
#include <ranges>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

/// JSON values. Parsed and written by nlohmann-json, which is included by a single source file: its header
/// takes three seconds of compile time to parse and ten to instantiate, this one a fraction of a second.
namespace palpate {

/// Error for a missing member or a value of another type than requested.
class JsonError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Member of an object. A template, so that Json may be incomplete at this point.
template <class Value>
struct JsonMember {
  bool operator==(const JsonMember&) const = default;

  std::string name;
  Value value;
};

/// Null, a boolean, a number, a text, an array or an object. Members of an object are in order of insertion;
/// those of a parsed object are sorted by name.
class Json {
 public:
  using Member = JsonMember<Json>;
  using Array = std::vector<Json>;
  using Object = std::vector<Member>;

  Json() = default;
  Json(std::nullptr_t) {}
  Json(bool value) : value_(value) {}
  template <std::signed_integral T>
  Json(T value) : value_(static_cast<std::int64_t>(value)) {}
  template <std::unsigned_integral T>
  requires(!std::same_as<T, bool>) Json(T value) : value_(static_cast<std::uint64_t>(value)) {}
  template <std::floating_point T>
  Json(T value) : value_(static_cast<double>(value)) {}
  Json(std::string text) : value_(std::move(text)) {}
  Json(std::string_view text) : value_(std::string(text)) {}
  Json(const char* text) : value_(std::string(text)) {}
  /// Makes an array from a range of values.
  template <std::ranges::input_range Range>
  requires(!std::same_as<Range, Json> && !std::convertible_to<const Range&, std::string_view> &&
           std::constructible_from<Json, std::ranges::range_reference_t<const Range>>)
      Json(const Range& values)
      : value_(Array()) {
    for (auto&& value : values) std::get<Array>(value_).emplace_back(value);
  }
  /// Makes an object from pairs of a text and a value, {{"name", "femur"}, {"value", 3}}; an array from
  /// anything else.
  Json(std::initializer_list<Json> values);
  static Json array() { return Json(Value(Array())); }
  static Json object() { return Json(Value(Object())); }

  /// Parses a text; nullopt if it is not valid JSON or is nested more than 500 levels deep. Of members with
  /// equal names the last one counts.
  static std::optional<Json> parse(std::string_view text);
  /// Serialises the value. Bytes that are not UTF-8 are replaced; a number that is not finite becomes null.
  /// @param indent  spaces for each level; negative: all on one line
  std::string dump(int indent = -1) const;

  bool is_null() const { return std::holds_alternative<std::monostate>(value_); }
  bool is_boolean() const { return std::holds_alternative<bool>(value_); }
  bool is_number() const { return value_.index() >= 2 && value_.index() <= 4; }
  bool is_string() const { return std::holds_alternative<std::string>(value_); }
  bool is_array() const { return std::holds_alternative<Array>(value_); }
  bool is_object() const { return std::holds_alternative<Object>(value_); }

  /// Converts the value to T: bool, a number, std::string, or a std::array or std::vector of those. Errors:
  /// JsonError for a value of another type, and for an array with fewer values.
  template <class T>
  T get() const {
    return read(Type<T>());
  }
  /// Text of a string. Errors: JsonError for any other type.
  const std::string& text() const;
  /// Compares numbers by value, regardless of their types, and members in their order.
  bool operator==(const Json& other) const;

  /// Number of values of an array or members of an object; otherwise 0.
  std::size_t size() const;
  bool empty() const { return size() == 0; }

  // Arrays. Iterating over any other type yields nothing. Errors: JsonError for an index out of range.
  const Json* begin() const;
  const Json* end() const;
  /// A template, because the literal 0 would also convert to a null const char*.
  template <std::integral T>
  const Json& operator[](T n) const {
    return value(static_cast<std::size_t>(n));
  }
  template <std::integral T>
  Json& operator[](T n) {
    return const_cast<Json&>(value(static_cast<std::size_t>(n)));
  }
  const Json& front() const { return (*this)[0]; }
  Json& back();
  /// Appends a value; null becomes an array. Errors: JsonError for any other type.
  void push_back(Json value);

  // Objects.
  /// Members of an object. Errors: JsonError for any other type.
  const Object& items() const;
  /// Finds a member by name; nullptr if there is none, or if this is not an object.
  const Json* find(std::string_view name) const;
  bool contains(std::string_view name) const { return find(name) != nullptr; }
  /// Member of this name. Errors: JsonError if there is none.
  const Json& at(std::string_view name) const;
  const Json& operator[](std::string_view name) const { return at(name); }
  /// Member of this name, added if there is none; null becomes an object. Errors: JsonError for any other
  /// type.
  Json& operator[](std::string_view name);
  /// Sets all members of `other`. Errors: JsonError unless both are objects.
  void update(const Json& other);

 private:
  friend class JsonBuilder;
  using Value =
      std::variant<std::monostate, bool, std::int64_t, std::uint64_t, double, std::string, Array, Object>;
  template <class T>
  struct Type {};

  explicit Json(Value value) : value_(std::move(value)) {}

  const Array& values() const;
  const Json& value(std::size_t n) const;
  bool boolean() const;
  /// Calls `use` with the number in its stored type.
  template <class Use>
  auto with_number(const Use& use) const {
    switch (value_.index()) {
      case 1:
        return use(std::get<1>(value_));
      case 2:
        return use(std::get<2>(value_));
      case 3:
        return use(std::get<3>(value_));
      case 4:
        return use(std::get<4>(value_));
    }
    throw JsonError("not a number");
  }

  bool read(Type<bool>) const { return boolean(); }
  std::string read(Type<std::string>) const { return text(); }
  template <class T>
  requires std::integral<T> || std::floating_point<T> T read(Type<T>)
  const {
    return with_number([](auto number) { return static_cast<T>(number); });
  }
  template <class T>
  std::vector<T> read(Type<std::vector<T>>) const {
    std::vector<T> out;
    for (const Json& value : values()) out.push_back(value.get<T>());
    return out;
  }
  template <class T, std::size_t kCount>
  std::array<T, kCount> read(Type<std::array<T, kCount>>) const {
    std::array<T, kCount> out;
    for (std::size_t n = 0; n < kCount; ++n) out[n] = (*this)[n].get<T>();
    return out;
  }

  Value value_;
};

}  // namespace palpate
