#include "haply/messages.h"

#include <rapidjson/document.h>
#include <rapidjson/stringbuffer.h>
#include <rapidjson/writer.h>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>

namespace palpate::haply {
namespace {

using Json = rapidjson::Value;

constexpr double kMmPerM = 1000;
// wiring of the vendor's handle: a, b, c are buttons 0, 1, 2
constexpr std::array kNamedButtons{"a", "b", "c"};

/// A parsed JSON text. A state of the service fits into preallocated memory, so that parsing, which is in the
/// path of every tick, does not allocate; longer texts do.
class Message {
 public:
  /// @param text  arbitrary bytes with arbitrary nesting
  explicit Message(std::string_view text) {
    // the parser stops at a NUL, ignoring what follows
    if (text.find('\0') != std::string_view::npos) return;
    // numbers are accurate to 3 units in the last place; RapidJSON's full-precision mode miscounts leading
    // zeros in numbers such as "0e300"
    constexpr unsigned kStrict = rapidjson::kParseIterativeFlag | rapidjson::kParseValidateEncodingFlag;
    document_.Parse<kStrict>(text.data(), text.size());
    is_json_ = !document_.HasParseError();
  }
  Message(const Message&) = delete;
  Message& operator=(const Message&) = delete;

  /// Valid only if is_json().
  bool is_json() const { return is_json_; }
  const Json& root() const { return document_; }

 private:
  using Pool = rapidjson::MemoryPoolAllocator<>;
  alignas(std::max_align_t) std::array<char, 16384> room_;
  alignas(std::max_align_t) std::array<char, 4096> stack_room_;
  Pool pool_{room_.data(), room_.size()}, stack_{stack_room_.data(), stack_room_.size()};
  rapidjson::GenericDocument<rapidjson::UTF8<>, Pool, Pool> document_{&pool_, 1024, &stack_};
  bool is_json_ = false;
};

const Json* member(const Json& object, const char* key) {
  if (!object.IsObject()) return nullptr;
  const auto found = object.FindMember(key);
  return found == object.MemberEnd() ? nullptr : &found->value;
}

const Json* list(const Json& object, const char* key) {
  const Json* value = member(object, key);
  return value && value->IsArray() ? value : nullptr;
}

std::optional<double> number(const Json& object, const char* key) {
  const Json* value = member(object, key);
  if (!value || !value->IsNumber()) return std::nullopt;
  const double is = value->GetDouble();
  return std::isfinite(is) ? std::optional(is) : std::nullopt;
}

std::optional<bool> flag(const Json& object, const char* key) {
  const Json* value = member(object, key);
  return value && value->IsBool() ? std::optional(value->GetBool()) : std::nullopt;
}

std::optional<Eigen::Vector3d> vector_in_mm(const Json& state, const char* key) {
  const Json* value = member(state, key);
  if (!value) return std::nullopt;
  const auto x = number(*value, "x"), y = number(*value, "y"), z = number(*value, "z");
  if (!x || !y || !z) return std::nullopt;
  const Eigen::Vector3d mm = kMmPerM * Eigen::Vector3d(*x, *y, *z);
  return mm.allFinite() ? std::optional(mm) : std::nullopt;
}

Inverse3 device_of(const Json& entry) {
  Inverse3 device;
  if (const Json* id = member(entry, "device_id"); id && id->IsString())
    device.id.assign(id->GetString(), id->GetStringLength());
  if (const Json* state = member(entry, "state")) {
    if (const auto tip = vector_in_mm(*state, "cursor_position")) device.tip_mm = Point<Device>(*tip);
    if (const auto velocity = vector_in_mm(*state, "cursor_velocity"))
      device.velocity_mm_s = Vector<Device>(*velocity);
  }
  if (const Json* status = member(entry, "status"))
    device.status = {flag(*status, "calibrated"), flag(*status, "power_supply"), flag(*status, "ready"),
                     flag(*status, "started"), flag(*status, "in_use")};
  return device;
}

Grip grip_of(const Json& entry) {
  Grip grip;
  const Json* state = member(entry, "state");
  if (!state) return grip;
  if (flag(*state, "button").value_or(false)) grip.buttons |= 1;
  if (const Json* buttons = member(*state, "buttons"))
    for (std::size_t n = 0; n < kNamedButtons.size(); ++n)
      if (flag(*buttons, kNamedButtons[n]).value_or(false)) grip.buttons |= 1u << n;
  if (const Json* q = member(*state, "orientation")) {
    const Eigen::Quaterniond read(number(*q, "w").value_or(0), number(*q, "x").value_or(0),
                                  number(*q, "y").value_or(0), number(*q, "z").value_or(0));
    // the squared norm of an invalid orientation may overflow
    const double largest = read.coeffs().cwiseAbs().maxCoeff();
    if (largest > 1e-3 && largest < 1e3) grip.orientation = read.normalized();
  }
  return grip;
}

void append(std::string& text, double value) {
  std::array<char, 32> digits;
  const auto end = std::to_chars(digits.data(), digits.data() + digits.size(),
                                 std::isfinite(value) ? value : 0, std::chars_format::general, 7);
  text.append(digits.data(), end.ptr);
}

}  // namespace

std::optional<ServiceVersion> parse_version(std::string_view text) {
  for (std::size_t begin = 0; begin < text.size(); ++begin) {
    const bool starts = std::isdigit(static_cast<unsigned char>(text[begin])) != 0 &&
                        (begin == 0 || (std::isdigit(static_cast<unsigned char>(text[begin - 1])) == 0 &&
                                        text[begin - 1] != '.'));
    if (!starts) continue;
    ServiceVersion version;
    const char* const last = text.data() + text.size();
    const auto major = std::from_chars(text.data() + begin, last, version.major);
    if (major.ec != std::errc() || major.ptr == last || *major.ptr != '.') continue;
    const auto minor = std::from_chars(major.ptr + 1, last, version.minor);
    if (minor.ec == std::errc() && version.minor >= 0) return version;
  }
  return std::nullopt;
}

const char* force_key(const ServiceVersion& version) {
  if (version.major != 3) return nullptr;
  if (version.minor <= 1) return "values";
  return version.minor >= 5 ? "vector" : nullptr;
}

bool reports_brake(std::string_view text) {
  // the layout of events is undocumented, so that keywords are searched
  if (!Message(text).is_json()) return false;
  return text.find("ebrake_triggered") != std::string_view::npos ||
         text.find("disconnect") != std::string_view::npos;
}

std::optional<State> parse_state(std::string_view text) {
  const Message message(text);
  const Json* devices = message.is_json() ? list(message.root(), "inverse3") : nullptr;
  if (!devices) return std::nullopt;
  State state;
  for (const Json& entry : devices->GetArray()) state.devices.push_back(device_of(entry));
  for (const char* kind : {"verse_grip", "wireless_verse_grip"})
    if (const Json* grips = list(message.root(), kind))
      for (const Json& entry : grips->GetArray()) state.grips.push_back(grip_of(entry));
  return state;
}

RequestWriter::RequestWriter(const std::vector<std::string>& ids, const char* key) {
  for (const std::string& id : ids) {
    rapidjson::StringBuffer quoted;
    rapidjson::Writer(quoted).String(id.data(), static_cast<rapidjson::SizeType>(id.size()));
    before_.push_back((before_.empty() ? "" : ",") + std::string("{\"device_id\":") + quoted.GetString() +
                      ",\"commands\":{\"set_cursor_force\":{\"" + key + "\":{\"x\":");
  }
}

const std::string& RequestWriter::write(bool first, std::span<const DeviceCommand> commands) {
  PALPATE_CHECK(commands.size() == before_.size());
  text_ = first ? "{\"session\":{\"configure\":{\"profile\":{\"name\":\"palpate\"}},"
                  "\"basis\":{\"permutation\":\"XYZ\"}},\"inverse3\":["
                : "{\"inverse3\":[";
  for (std::size_t d = 0; d < before_.size(); ++d) {
    const Vector<Device>& force = commands[d].force_N;
    text_ += before_[d];
    append(text_, force.x());
    text_ += ",\"y\":";
    append(text_, force.y());
    text_ += ",\"z\":";
    append(text_, force.z());
    text_ += "}}}}";
  }
  text_ += "]}";
  return text_;
}

}  // namespace palpate::haply
