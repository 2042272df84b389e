#include "palpate/json/json.h"

#include <algorithm>
#include <nlohmann/json.hpp>

namespace palpate {
namespace {

// deeper values would exhaust the stack when they are copied or destroyed
constexpr std::size_t kMaxLevels = 500;

}  // namespace

/// Converts nlohmann-json's parser events to a Json, and a Json to nlohmann-json's value type.
class JsonBuilder {
 public:
  bool null() { return add(Json()); }
  bool boolean(bool value) { return add(Json(value)); }
  bool number_integer(std::int64_t value) { return add(Json(value)); }
  bool number_unsigned(std::uint64_t value) { return add(Json(value)); }
  bool number_float(double value, const std::string&) { return add(Json(value)); }
  bool string(std::string& text) { return add(Json(std::move(text))); }
  bool binary(const nlohmann::json::binary_t&) { return false; }
  bool start_array(std::size_t) { return open(Json::array()); }
  bool start_object(std::size_t) { return open(Json::object()); }
  bool key(std::string& name) {
    names_.push_back(std::move(name));
    return true;
  }
  bool end_array() { return close(); }
  bool end_object() {
    Json::Object& members = std::get<Json::Object>(open_.back().value_);
    std::ranges::stable_sort(members, {}, &Json::Member::name);
    // keeps the last one of members with equal names
    Json::Object stored;
    for (std::size_t n = 0; n < members.size(); ++n)
      if (n + 1 == members.size() || members[n].name != members[n + 1].name)
        stored.push_back(std::move(members[n]));
    members = std::move(stored);
    return close();
  }
  bool parse_error(std::size_t, const std::string&, const nlohmann::detail::exception&) { return false; }

  Json take() { return std::move(done_); }

  static nlohmann::ordered_json to_nlohmann(const Json& json) {
    using Written = nlohmann::ordered_json;
    return std::visit(
        [](const auto& value) {
          using T = std::decay_t<decltype(value)>;
          Written out;
          if constexpr (std::is_same_v<T, Json::Array>) {
            out = Written::array();
            for (const Json& each : value) out.push_back(to_nlohmann(each));
          } else if constexpr (std::is_same_v<T, Json::Object>) {
            out = Written::object();
            // names are unique already
            auto& members = out.get_ref<Written::object_t&>();
            for (const Json::Member& member : value)
              members.emplace_back(member.name, to_nlohmann(member.value));
          } else if constexpr (!std::is_same_v<T, std::monostate>) {
            out = value;
          }
          return out;
        },
        json.value_);
  }

 private:
  bool open(Json value) {
    open_.push_back(std::move(value));
    return open_.size() <= kMaxLevels;
  }
  bool close() {
    Json value = std::move(open_.back());
    open_.pop_back();
    return add(std::move(value));
  }
  bool add(Json value) {
    if (open_.empty()) {
      done_ = std::move(value);
    } else if (Json& into = open_.back(); into.is_array()) {
      std::get<Json::Array>(into.value_).push_back(std::move(value));
    } else {
      std::get<Json::Object>(into.value_).push_back({std::move(names_.back()), std::move(value)});
      names_.pop_back();
    }
    return true;
  }

  std::vector<Json> open_;
  std::vector<std::string> names_;
  Json done_;
};

Json::Json(std::initializer_list<Json> values) {
  const bool has_names = std::all_of(values.begin(), values.end(), [](const Json& each) {
    return each.is_array() && each.size() == 2 && each[0].is_string();
  });
  if (!has_names) {
    value_ = Array(values);
    return;
  }
  value_ = Object();
  for (const Json& each : values) (*this)[each[0].text()] = each[1];
}

std::optional<Json> Json::parse(std::string_view text) {
  JsonBuilder builder;
  if (!nlohmann::json::sax_parse(text, &builder)) return {};
  return builder.take();
}

std::string Json::dump(int indent) const {
  return JsonBuilder::to_nlohmann(*this).dump(indent, ' ', false,
                                              nlohmann::ordered_json::error_handler_t::replace);
}

const std::string& Json::text() const {
  if (const std::string* text = std::get_if<std::string>(&value_)) return *text;
  throw JsonError("not a string");
}

bool Json::operator==(const Json& other) const {
  if (is_number() && other.is_number() && value_.index() != other.value_.index())
    return get<double>() == other.get<double>();
  return value_ == other.value_;
}

bool Json::boolean() const {
  if (const bool* value = std::get_if<bool>(&value_)) return *value;
  throw JsonError("not a boolean");
}

const Json::Array& Json::values() const {
  if (const Array* values = std::get_if<Array>(&value_)) return *values;
  throw JsonError("not an array");
}

std::size_t Json::size() const {
  if (const Array* values = std::get_if<Array>(&value_)) return values->size();
  if (const Object* members = std::get_if<Object>(&value_)) return members->size();
  return 0;
}

const Json* Json::begin() const {
  const Array* values = std::get_if<Array>(&value_);
  return values != nullptr ? values->data() : nullptr;
}

const Json* Json::end() const {
  const Array* values = std::get_if<Array>(&value_);
  return values != nullptr ? values->data() + values->size() : nullptr;
}

const Json& Json::value(std::size_t n) const {
  if (n >= values().size()) throw JsonError("no value at this index");
  return values()[n];
}

Json& Json::back() {
  if (values().empty()) throw JsonError("an empty array");
  return std::get<Array>(value_).back();
}

void Json::push_back(Json value) {
  if (is_null()) value_ = Array();
  if (!is_array()) throw JsonError("not an array");
  std::get<Array>(value_).push_back(std::move(value));
}

const Json::Object& Json::items() const {
  if (const Object* members = std::get_if<Object>(&value_)) return *members;
  throw JsonError("not an object");
}

const Json* Json::find(std::string_view name) const {
  if (!is_object()) return nullptr;
  for (const Member& member : items())
    if (member.name == name) return &member.value;
  return nullptr;
}

const Json& Json::at(std::string_view name) const {
  if (const Json* found = find(name)) return *found;
  throw JsonError("no member \"" + std::string(name) + "\"");
}

Json& Json::operator[](std::string_view name) {
  if (is_null()) value_ = Object();
  if (!is_object()) throw JsonError("not an object");
  Object& members = std::get<Object>(value_);
  for (Member& member : members)
    if (member.name == name) return member.value;
  return members.emplace_back(Member{std::string(name), Json()}).value;
}

void Json::update(const Json& other) {
  if (!is_object()) throw JsonError("not an object");
  for (const auto& [name, value] : other.items()) (*this)[name] = value;
}

}  // namespace palpate
