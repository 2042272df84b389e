#include "server/flat_json.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

namespace palpate::server {
namespace {

using PlainJson = nlohmann::json;

/// SAX handler that returns false, and thereby stops the parser, at the first unsupported event: nothing has
/// to be built and validated afterwards.
class Events : public nlohmann::json_sax<PlainJson> {
 public:
  explicit Events(FlatObject& object) : object_(object) {}

  bool null() override { return false; }
  bool boolean(bool value) override { return !in_list_ && take(value); }
  bool number_integer(number_integer_t value) override { return take_number(value); }
  bool number_unsigned(number_unsigned_t value) override {
    if (value > static_cast<number_unsigned_t>(std::numeric_limits<std::int64_t>::max())) return false;
    return take_number(static_cast<std::int64_t>(value));
  }
  bool number_float(number_float_t value, const string_t&) override {
    return std::isfinite(value) && take_number(value);
  }
  bool string(string_t& value) override { return !in_list_ && take(std::move(value)); }
  bool binary(binary_t&) override { return false; }
  bool start_object(std::size_t) override { return !std::exchange(in_object_, true); }
  bool key(string_t& value) override {
    if (object_.find(value)) return false;
    key_ = std::move(value);
    return true;
  }
  bool end_object() override { return true; }
  bool start_array(std::size_t) override {
    return !std::exchange(in_list_, true) && take(std::vector<double>{});
  }
  bool end_array() override {
    in_list_ = false;
    return true;
  }
  bool parse_error(std::size_t, const std::string&, const nlohmann::detail::exception&) override {
    return false;
  }

 private:
  template <class Value>
  bool take(Value value) {
    if (!in_object_) return false;
    FlatValue& content = object_.entries.emplace_back(std::move(key_), FlatValue()).second;
    content.emplace<Value>(std::move(value));
    return true;
  }
  template <class Number>
  bool take_number(Number value) {
    if (!in_list_) return take(value);
    std::get<std::vector<double>>(object_.entries.back().second).push_back(static_cast<double>(value));
    return true;
  }

  FlatObject& object_;
  std::string key_;
  bool in_object_ = false, in_list_ = false;
};

}  // namespace

const FlatValue* FlatObject::find(std::string_view key) const {
  const auto found =
      std::find_if(entries.begin(), entries.end(), [&](const auto& entry) { return entry.first == key; });
  return found == entries.end() ? nullptr : &found->second;
}

std::optional<FlatObject> parse_flat_json(std::string_view text) {
  // the parser treats a zero byte as the end of input
  if (text.find('\0') != text.npos) return std::nullopt;
  FlatObject object;
  Events events(object);
  if (!PlainJson::sax_parse(text.begin(), text.end(), &events)) return std::nullopt;
  return object;
}

}  // namespace palpate::server
