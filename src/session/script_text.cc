#include "session/script_text.h"

#include <cstdio>

namespace palpate {
namespace {

// shortest digits that read back as the same number, always a float in TOML
std::string number(double value) {
  char text[40];
  for (int digits = 1; digits <= 17; ++digits) {
    std::snprintf(text, sizeof text, "%.*g", digits, value);
    if (std::stod(text) == value) break;
  }
  std::string result = text;
  if (result.find_first_of(".e") == std::string::npos) result += ".0";
  return result;
}

std::string quoted(const std::string& text) {
  std::string result = "\"";
  for (const char c : text) {
    char escaped[8];
    if (c == '"' || c == '\\') {
      result += '\\';
      result += c;
    } else if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) {
      std::snprintf(escaped, sizeof escaped, "\\u%04x", static_cast<unsigned>(static_cast<unsigned char>(c)));
      result += escaped;
    } else {
      result += c;
    }
  }
  return result + "\"";
}

std::string array(const Eigen::Vector3d& v) {
  return "[" + number(v.x()) + ", " + number(v.y()) + ", " + number(v.z()) + "]";
}

std::string line(const char* key, const std::string& value) {
  return std::string(key) + " = " + value + "\n";
}

struct StepText {
  std::string operator()(const ApproachStep& s) const {
    return line("approach", quoted(s.structure)) + line("speed", number(s.speed_mm_s)) +
           line("clearance", number(s.clearance_mm));
  }
  std::string operator()(const PressStep& s) const {
    return line("press", number(s.force_N)) + line("settle", number(s.settle_s));
  }
  std::string operator()(const HoldStep& s) const { return line("hold", number(s.seconds)); }
  std::string operator()(const SlideStep& s) const {
    return line("slide", number(s.distance_mm)) + line("direction", array(s.direction.eigen())) +
           line("speed", number(s.speed_mm_s));
  }
  std::string operator()(const RotateStep& s) const {
    return line("rotate", number(s.degrees)) + line("axis", array(s.axis_world)) +
           line("seconds", number(s.seconds));
  }
  std::string operator()(const MethodStep& s) const {
    return line("method", quoted(std::string(name_of(s.method))));
  }
  std::string operator()(const LeaveStep& s) const {
    return line("leave", "true") + line("speed", number(s.speed_mm_s));
  }
};

}  // namespace

std::string script_text(const Script& script) {
  std::string text = line("title", quoted(script.title)) + line("device", quoted(script.device)) +
                     line("hand", quoted(script.hand)) + line("rate", number(script.rate_hz)) +
                     line("delay", number(script.delay_s * 1e3)) + line("tremor", number(script.tremor_mm)) +
                     line("seed", std::to_string(script.seed));
  for (const ScriptStep& step : script.steps) text += "\n[[step]]\n" + std::visit(StepText{}, step);
  return text;
}

}  // namespace palpate
