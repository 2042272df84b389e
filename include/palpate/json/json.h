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

/// JSON values. Parsed and written by nlohmann-json, which one source includes: its header takes a compiler
/// three seconds to parse and ten to instantiate, this one a fraction of a second.
namespace palpate {

/// A member that is missing, or a value of another type than the one that was asked for.
class JsonError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A member of an object. A template, so that Json may be incomplete where it is named.
template <class Value>
struct JsonMember {
  bool operator==(const JsonMember&) const = default;

  std::string name;
  Value value;
};

/// Null, a boolean, a number, a text, an array or an object. Members of an object keep the order in which
/// they were added; those of a parsed object are sorted by their names.
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
  /// A range of values is an array.
  template <std::ranges::input_range Range>
  requires(!std::same_as<Range, Json> && !std::convertible_to<const Range&, std::string_view> &&
           std::constructible_from<Json, std::ranges::range_reference_t<const Range>>)
      Json(const Range& values)
      : value_(Array()) {
    for (auto&& value : values) std::get<Array>(value_).emplace_back(value);
  }
  /// Pairs of a text and a value are an object, {{"name", "femur"}, {"value", 3}}; anything else is an array.
  Json(std::initializer_list<Json> values);
  static Json array() { return Json(Value(Array())); }
  static Json object() { return Json(Value(Object())); }

  /// Nothing for what is not valid JSON, or nests deeper than 500 levels. Of members with one name the last
  /// counts.
  static std::optional<Json> parse(std::string_view text);
  /// Bytes that are not UTF-8 are replaced; a number that is not finite becomes null.
  /// @param indent  spaces for each level; below 0: all in one line
  std::string dump(int indent = -1) const;

  bool is_null() const { return std::holds_alternative<std::monostate>(value_); }
  bool is_boolean() const { return std::holds_alternative<bool>(value_); }
  bool is_number() const { return value_.index() >= 2 && value_.index() <= 4; }
  bool is_string() const { return std::holds_alternative<std::string>(value_); }
  bool is_array() const { return std::holds_alternative<Array>(value_); }
  bool is_object() const { return std::holds_alternative<Object>(value_); }

  /// The value as a T: bool, a number, std::string, or a std::array or std::vector of such. Errors: JsonError
  /// for a value of another type, and for an array of fewer values.
  template <class T>
  T get() const {
    return read(Type<T>());
  }
  /// Errors: JsonError for what is not a text.
  const std::string& text() const;
  /// Numbers are compared by value, whichever type they have; members in their order.
  bool operator==(const Json& other) const;

  /// Of an array or an object, else 0.
  std::size_t size() const;
  bool empty() const { return size() == 0; }

  // Arrays. What is not one has no values to iterate over. Errors: JsonError for an index that is too large.
  const Json* begin() const;
  const Json* end() const;
  /// A template, as the literal 0 would also be the null pointer of a text.
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
  /// Null becomes an array. Errors: JsonError for what is neither.
  void push_back(Json value);

  // Objects
  /// Errors: JsonError for what is not an object.
  const Object& items() const;
  /// Null where there is no such member, and of what is not an object.
  const Json* find(std::string_view name) const;
  bool contains(std::string_view name) const { return find(name) != nullptr; }
  /// Errors: JsonError where there is no such member.
  const Json& at(std::string_view name) const;
  const Json& operator[](std::string_view name) const { return at(name); }
  /// Adds the member where there is none; null becomes an object. Errors: JsonError for what is neither.
  Json& operator[](std::string_view name);
  /// Sets the members that `other` has. Errors: JsonError unless both are objects.
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
  /// Calls `use` with the number in the type that it has.
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
