#include "server/request.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <numeric>

#include "server/flat_json.h"

namespace palpate::server {
namespace {

// largest integer that JavaScript's numbers represent exactly
constexpr std::int64_t kMaxId = (std::int64_t{1} << 53) - 1;
constexpr std::size_t kMaxName_bytes = 64, kMaxToken_bytes = 1024, kMaxTask_bytes = 256,
                      kMaxTrajectory_bytes = 200;
constexpr int kMaxTissues = 1 << 16;
// larger than any valid plan
constexpr int kMaxTrajectories = 1000;
constexpr std::size_t kMaxCode_bytes = 16;
// maximum deviation of the norm of a quaternion or direction from 1; viewers compute in single precision
constexpr double kUnitTolerance = 1e-3;
// largest force to press with, that of --max-force
constexpr double kMaxPress_N = 40;

/// Removes a prefix and the blanks before it; false if the text does not begin with it.
bool take(std::string_view& text, std::string_view front) {
  text.remove_prefix(std::min(text.find_first_not_of(" \t\r\n"), text.size()));
  if (!text.starts_with(front)) return false;
  text.remove_prefix(front.size());
  return true;
}

// for a text that is not a valid message: whether `"type": "stop"` occurs anywhere in it
bool contains_stop(std::string_view text) {
  constexpr std::string_view kKey = "\"type\"";
  for (std::size_t at = text.find(kKey); at != text.npos; at = text.find(kKey, at + 1)) {
    std::string_view remaining = text.substr(at + kKey.size());
    if (take(remaining, ":") && take(remaining, "\"stop\"")) return true;
  }
  return false;
}

/// Reads the values of one message; the first invalid value becomes the refusal.
class Fields {
 public:
  explicit Fields(const FlatObject& object) : object_(object) {}

  std::optional<bool> flag(std::string_view key) { return get<bool>(key, "true or false"); }
  std::optional<std::string> name(std::string_view key, std::size_t max_bytes) {
    auto text = get<std::string>(key, "a text");
    if (text && text->size() > max_bytes) return refuse(key, "is too long"), std::nullopt;
    return text;
  }
  std::optional<double> number(std::string_view key) {
    const FlatValue* value = find(key);
    if (!value) return std::nullopt;
    if (const auto* whole = std::get_if<std::int64_t>(value)) return static_cast<double>(*whole);
    if (const auto* real = std::get_if<double>(value)) return *real;
    return refuse(key, "is not a number"), std::nullopt;
  }
  std::optional<std::int64_t> integer(std::string_view key, std::int64_t smallest, std::int64_t largest) {
    const auto value = get<std::int64_t>(key, "a whole number");
    if (value && (*value < smallest || *value > largest)) return refuse(key, "is out of range"), std::nullopt;
    return value;
  }
  template <std::size_t kCount>
  std::optional<std::array<double, kCount>> numbers(std::string_view key) {
    const auto list = get<std::vector<double>>(key, "a list of numbers");
    if (!list) return std::nullopt;
    if (list->size() != kCount)
      return refuse(key, "does not have " + std::to_string(kCount) + " numbers"), std::nullopt;
    std::array<double, kCount> values{};
    std::copy(list->begin(), list->end(), values.begin());
    return values;
  }
  std::optional<std::array<double, 4>> rotation(std::string_view key) {
    return unit<4>(key, "is not a unit quaternion w, x, y, z");
  }
  std::optional<std::array<double, 3>> direction(std::string_view key) {
    return unit<3>(key, "is not a unit vector");
  }

  /// Reads the value of a setting by its type.
  void read(std::string_view key, std::optional<bool>& value) { value = flag(key); }
  void read(std::string_view key, std::optional<double>& value) { value = number(key); }
  void read(std::string_view key, std::optional<std::string>& value) { value = name(key, kMaxName_bytes); }
  void read(std::string_view key, std::optional<std::array<double, 4>>& value) { value = rotation(key); }

  bool has(std::string_view key) const { return object_.find(key) != nullptr; }
  void want(std::string_view key) {
    if (!has(key)) refuse(key, "is missing");
  }
  /// Refuses any key that was not read.
  void end() {
    for (const auto& [key, value] : object_.entries) {
      if (std::find(read_.begin(), read_.end(), key) != read_.end()) continue;
      // the key is the viewer's own text, which is never sent back
      refuse("", "is not a key of this kind of message");
    }
  }
  void refuse(std::string_view key, std::string what) {
    if (!refusal_)
      refusal_ = Error{ErrorKind::kUsage, std::move(what), std::string(key),
                       "see docs/reference/viewer-requests.md"};
  }
  const std::optional<Error>& refusal() const { return refusal_; }

 private:
  const FlatValue* find(std::string_view key) {
    read_.push_back(key);
    return object_.find(key);
  }
  template <class T>
  std::optional<T> get(std::string_view key, const char* kind) {
    const FlatValue* value = find(key);
    if (!value) return std::nullopt;
    if (const T* content = std::get_if<T>(value)) return *content;
    return refuse(key, std::string("is not ") + kind), std::nullopt;
  }

  template <std::size_t kCount>
  std::optional<std::array<double, kCount>> unit(std::string_view key, const char* fault) {
    auto values = numbers<kCount>(key);
    if (!values) return std::nullopt;
    const double length = std::sqrt(std::inner_product(values->begin(), values->end(), values->begin(), 0.0));
    if (!(std::abs(length - 1) <= kUnitTolerance)) return refuse(key, fault), std::nullopt;
    for (double& value : *values) value /= length;
    return values;
  }

  const FlatObject& object_;
  std::vector<std::string_view> read_;
  std::optional<Error> refusal_;
};

SettingsRequest read_settings(Fields& fields) {
  SettingsRequest request;
  request.law = fields.name(kLawSetting, kMaxName_bytes);
  bool any = request.law.has_value();
  visit_settings([&](const auto& setting) {
    auto& requested = request.*setting.change;
    fields.read(setting.name, requested);
    any = any || requested;
  });
  fields.end();
  if (!any) fields.refuse("", "the request is empty");
  return request;
}

TissueRequest read_tissue(Fields& fields) {
  TissueRequest request;
  fields.want("tissue");
  request.tissue = static_cast<int>(fields.integer("tissue", 0, kMaxTissues).value_or(0));
  for (const ContactProperty& property : kContactProperties)
    request.changes[property.value] = fields.number(property.name);
  fields.end();
  if (request.changes.empty()) fields.refuse("", "the request is empty");
  return request;
}

PointerRequest read_pointer(Fields& fields) {
  fields.want("take");
  const PointerRequest request{fields.flag("take").value_or(false)};
  fields.end();
  return request;
}

PlayRequest read_play(Fields& fields) {
  PlayRequest request;
  request.at_s = fields.number("at_s");
  request.playing = fields.flag("playing");
  request.speed = fields.number("speed");
  const bool any = request.at_s || request.playing || request.speed;
  const double speed = std::abs(request.speed.value_or(1));
  if (!(speed >= kPlayingSpeeds[0] && speed <= kPlayingSpeeds[1])) fields.refuse("speed", "is out of range");
  fields.end();
  if (!any) fields.refuse("", "the request is empty");
  return request;
}

TaskRequest read_task(Fields& fields) {
  TaskRequest request;
  request.begin = fields.name("begin", kMaxTask_bytes);
  request.end = fields.flag("end").value_or(false);
  fields.end();
  if (request.begin.has_value() == request.end) fields.refuse("", "needs exactly one of begin and end");
  return request;
}

LessonRequest read_lesson(Fields& fields) {
  LessonRequest request;
  request.learner = fields.name("learner", kMaxName_bytes);
  request.task = fields.name("task", kMaxTask_bytes);
  request.names = fields.flag("names");
  request.pointer = fields.name("pointer", kMaxName_bytes);
  request.end = fields.flag("end").value_or(false);
  fields.end();
  if (!request.learner && !request.task && !request.names && !request.pointer && !request.end)
    fields.refuse("", "the request is empty");
  return request;
}

PlanRequest read_plan(Fields& fields) {
  PlanRequest request;
  fields.want("version");
  request.version = static_cast<std::uint32_t>(fields.integer("version", 0, 0xffffffff).value_or(0));
  if (const auto trajectory_index = fields.integer("trajectory", 0, kMaxTrajectories))
    request.trajectory = static_cast<std::size_t>(*trajectory_index);
  request.name = fields.name("name", kMaxTrajectory_bytes);
  request.entry_mm = fields.numbers<3>("entry_mm");
  request.target_mm = fields.numbers<3>("target_mm");
  request.remove = fields.flag("remove").value_or(false);
  if (const auto version = fields.integer("back_to", 0, 0xffffffff))
    request.restore_version = static_cast<std::uint32_t>(*version);
  request.save = fields.flag("save").value_or(false);
  fields.end();
  const bool changes = request.name || request.entry_mm || request.target_mm;
  const int requested =
      int{changes} + int{request.remove} + int{request.restore_version.has_value()} + int{request.save};
  if (requested != 1) fields.refuse("", "needs exactly one of a change, remove, back_to and save");
  if (request.trajectory.has_value() != (changes || request.remove))
    fields.refuse("trajectory", "is only for a change and for remove");
  return request;
}

std::optional<ViewerMessage> read_hello(Fields& fields) {
  Hello hello;
  fields.want("protocol");
  hello.protocol = static_cast<int>(fields.integer("protocol", 0, 1 << 16).value_or(0));
  hello.token = fields.name("token", kMaxToken_bytes).value_or("");
  hello.poses_hz = fields.number("poses_hz").value_or(hello.poses_hz);
  hello.wants_deformation = fields.flag("yielded").value_or(false);
  hello.wants_task = fields.flag("task").value_or(false);
  hello.wants_plan = fields.flag("plan").value_or(false);
  hello.wants_distances = fields.flag("near").value_or(false);
  hello.wants_ticks = fields.flag("ticks").value_or(false);
  hello.wants_navigation = fields.flag("navigation").value_or(false);
  fields.end();
  if (fields.refusal() || !(hello.poses_hz >= 1 && hello.poses_hz <= kMaxPoses_hz)) return std::nullopt;
  return hello;
}

std::optional<ViewerMessage> read_tip(Fields& fields) {
  const auto tip = fields.numbers<3>("patient_mm");
  const auto into = fields.direction("into");
  const auto force_N = fields.number("force_N");
  const auto set_down = fields.flag("set_down");
  fields.end();
  if (!tip || fields.refusal() || into.has_value() != force_N.has_value()) return std::nullopt;
  if (force_N && !(*force_N > 0 && *force_N <= kMaxPress_N)) return std::nullopt;
  return TipMessage{PointerTarget{*tip, into.value_or(std::array<double, 3>{}), force_N.value_or(0),
                                  set_down.value_or(false)}};
}

std::optional<ViewerMessage> parse_message(std::string_view text) {
  if (text.size() > kMaxMessage_bytes) return std::nullopt;
  const auto object = parse_flat_json(text);
  if (!object) return std::nullopt;
  Fields fields(*object);
  const auto type = fields.name("type", kMaxName_bytes);
  if (!type) return std::nullopt;
  if (*type == "hello") return read_hello(fields);
  if (*type == "tip") return read_tip(fields);
  if (*type == "lift") {
    fields.end();
    if (fields.refusal()) return std::nullopt;
    return TipMessage{};
  }

  const auto id = fields.integer("id", 0, kMaxId);
  if (*type == "stop") return Request{id.value_or(0), StopRequest{}};
  if (!id) return std::nullopt;
  Request request;
  request.id = *id;
  if (*type == "set") {
    request.body = read_settings(fields);
  } else if (*type == "tissue") {
    request.body = read_tissue(fields);
  } else if (*type == "undo" || *type == "redo") {
    StrokeRequest stroke;
    stroke.action = *type == "undo" ? StrokeAction::kUndo : StrokeAction::kRedo;
    request.body = stroke;
    fields.end();
  } else if (*type == "pointer") {
    request.body = read_pointer(fields);
  } else if (*type == "play") {
    request.body = read_play(fields);
  } else if (*type == "task") {
    request.body = read_task(fields);
  } else if (*type == "lesson") {
    request.body = read_lesson(fields);
  } else if (*type == "plan") {
    request.body = read_plan(fields);
  } else if (*type == "rearm") {
    fields.want("stop");
    RearmRequest rearm;
    rearm.stop = static_cast<std::uint32_t>(fields.integer("stop", 0, 0xffffffff).value_or(0));
    rearm.code = fields.name("code", kMaxCode_bytes).value_or("");
    request.body = rearm;
    fields.end();
  } else {
    fields.refuse("type", "is unknown");
  }
  if (fields.refusal()) request.body = *fields.refusal();
  return request;
}

}  // namespace

std::optional<ViewerMessage> parse_viewer_message(std::string_view text) {
  // a stop is honoured however malformed the message is
  auto message = parse_message(text);
  if (!message && contains_stop(text)) message = Request{0, StopRequest{}};
  return message;
}

bool is_stop(const std::optional<ViewerMessage>& message) {
  const auto* request = message ? std::get_if<Request>(&*message) : nullptr;
  return request && std::holds_alternative<StopRequest>(request->body);
}

}  // namespace palpate::server
