#include "session/setting_changes.h"

#include <cmath>
#include <cstdio>
#include <numbers>
#include <optional>
#include <utility>

#include "palpate/palpation/plain_vectors.h"
#include "palpate/scene/scene.h"

namespace palpate {
namespace {

/// Enumeration of changes, joined by "and".
class Words {
 public:
  Words& add(const std::string& what) {
    text_ += (text_.empty() ? "" : ", and ") + what;
    return *this;
  }
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

// names come from files: control characters are replaced so that none can move a terminal's cursor
std::string plain_name(std::string name) {
  for (char& c : name)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '?';
  return name;
}

}  // namespace

std::string rounded_text(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

SettingsRequest changes_of(SettingsRequest request, const Parameters& now, TissueLaw law, bool is_law_awaited,
                           bool is_method_awaited) {
  const auto leave_out = [](auto& wanted, const auto& held) {
    if (wanted && *wanted == held) wanted.reset();
  };
  if (!is_method_awaited) leave_out(request.method, std::string(name_of(now.method)));
  if (!is_law_awaited) leave_out(request.law, std::string(name_of(law, kTissueLaws)));
  leave_out(request.friction, now.friction);
  leave_out(request.viscosity, now.viscosity);
  leave_out(request.passivity, now.passivity);
  leave_out(request.paused, now.paused);
  leave_out(request.motor, now.motor);
  leave_out(request.max_force_N, now.max_force_N);
  const Eigen::Quaterniond& q = now.rotation_target;
  leave_out(request.rotation_wxyz, std::array{q.w(), q.x(), q.y(), q.z()});
  return request;
}

bool could_increase_force(const SettingsRequest& wanted, const Parameters& now) {
  return (wanted.max_force_N && *wanted.max_force_N > now.max_force_N) || wanted.friction == true ||
         wanted.viscosity == true || wanted.passivity == false || wanted.paused == false ||
         wanted.motor == true || wanted.law.has_value();
}

void apply_settings(const SettingsRequest& request, Parameters& parameters) {
  if (request.friction) parameters.friction = *request.friction;
  if (request.viscosity) parameters.viscosity = *request.viscosity;
  if (request.passivity) parameters.passivity = *request.passivity;
  if (request.paused) parameters.paused = *request.paused;
  if (request.motor) parameters.motor = *request.motor;
  if (request.max_force_N) parameters.max_force_N = *request.max_force_N;
  if (request.rotation_wxyz) parameters.rotation_target = quaternion(*request.rotation_wxyz).normalized();
}

std::string consent_text(const SettingsRequest& wanted, const Parameters& now) {
  Words words;
  const auto switched = [&](const std::optional<bool>& on, const char* what) {
    if (on) words.add(std::string("switch ") + what + (*on ? " on" : " off"));
  };
  if (wanted.rotation_wxyz) {
    constexpr double kDegrees = 180 / std::numbers::pi;
    const double by = now.rotation_target.angularDistance(quaternion(*wanted.rotation_wxyz).normalized());
    words.add("turn the object by " + rounded_text(std::round(by * kDegrees * 10) / 10) + " degrees");
  }
  if (wanted.paused) words.add(*wanted.paused ? "pause the force" : "resume the force");
  if (wanted.max_force_N)
    words.add("set the force limit to " + rounded_text(*wanted.max_force_N) + " N, now " +
              rounded_text(now.max_force_N));
  if (wanted.method) words.add("use the method " + *wanted.method);
  if (wanted.law) words.add("use the soft-tissue law " + *wanted.law);
  switched(wanted.friction, "friction");
  switched(wanted.viscosity, "viscosity");
  switched(wanted.passivity, "the passivity controller");
  switched(wanted.motor, "the tool's motor");
  return words.text();
}

std::string consent_text(const std::string& tissue, const ContactProperties& before,
                         const ContactProperties& after) {
  Words words;
  for (const ContactProperty& property : kContactProperties) {
    const double from = before.*property.value, to = after.*property.value;
    if (from == to) continue;
    const std::string whose = words.text().empty() ? plain_name(tissue) + "'s " : std::string("its ");
    words.add("change " + whose + std::string(property.words) + " from " + rounded_text(from) + " to " +
              rounded_text(to) + (property.unit.empty() ? "" : " ") + std::string(property.unit));
  }
  return words.text();
}

}  // namespace palpate
