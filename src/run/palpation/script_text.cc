#include "palpation/script_text.h"
#include "palpate/scene/named_values.h"

#include <cstdio>

namespace palpate {
namespace {

// fewest digits that parse to the same number, always a TOML float
std::string shortest_number(double value) {
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
  return "[" + shortest_number(v.x()) + ", " + shortest_number(v.y()) + ", " + shortest_number(v.z()) + "]";
}

std::string line(const char* key, const std::string& value) {
  return std::string(key) + " = " + value + "\n";
}

struct StepText {
  std::string operator()(const ApproachStep& s) const {
    std::string text = line("approach", s.point ? array(s.point->eigen()) : quoted(s.structure));
    for (const auto& [name, direction] : kPatientDirections)
      if (s.landmark && *s.landmark == Vector<Patient>(direction[0], direction[1], direction[2]))
        text += line("landmark", quoted(std::string(name)));
    if (const auto* structure = std::get_if<std::string>(&s.nearest))
      text += line("nearest", quoted(*structure));
    if (const auto* point = std::get_if<Point<Patient>>(&s.nearest))
      text += line("nearest", array(point->eigen()));
    if (s.from) text += line("from", array(s.from->eigen()));
    return text + line("speed", shortest_number(s.speed_mm_s)) +
           line("clearance", shortest_number(s.clearance_mm));
  }
  std::string operator()(const PressStep& s) const {
    return line("press", shortest_number(s.force_N)) + line("settle", shortest_number(s.settle_s));
  }
  std::string operator()(const HoldStep& s) const { return line("hold", shortest_number(s.seconds)); }
  std::string operator()(const SlideStep& s) const {
    return line("slide", shortest_number(s.distance_mm)) + line("direction", array(s.direction.eigen())) +
           line("speed", shortest_number(s.speed_mm_s));
  }
  std::string operator()(const MillStep& s) const {
    return line("mill", array(s.to.eigen())) + line("force", shortest_number(s.force_N)) +
           line("speed", shortest_number(s.speed_mm_s));
  }
  std::string operator()(const RotateStep& s) const {
    return line("rotate", shortest_number(s.degrees)) + line("axis", array(s.axis_world)) +
           line("seconds", shortest_number(s.seconds));
  }
  std::string operator()(const MethodStep& s) const {
    return line("method", quoted(std::string(name_of(s.method))));
  }
  std::string operator()(const MotorStep& s) const { return line("motor", s.on ? "true" : "false"); }
  std::string operator()(const StrokeStep& s) const {
    return line("stroke", quoted(s.action == StrokeAction::kUndo ? "undo" : "redo"));
  }
  std::string operator()(const LawStep& s) const {
    return line("law", quoted(std::string(name_of(s.law, kTissueLaws))));
  }
  std::string operator()(const ScopeStep& s) const {
    return line("scope", s.at ? array(s.at->eigen()) : quoted("probe")) +
           line("from", array(s.from.eigen())) + line("distance", shortest_number(s.distance_mm)) +
           line("speed", shortest_number(s.speed_mm_s)) + line("optics", shortest_number(s.optics.lean_deg)) +
           line("back", shortest_number(s.optics.back_mm));
  }
  std::string operator()(const LeaveStep& s) const {
    return line("leave", "true") + line("speed", shortest_number(s.speed_mm_s));
  }
};

}  // namespace

std::string script_text(const Script& script) {
  std::string text = line("title", quoted(script.title)) + line("device", quoted(script.device)) +
                     line("hand", quoted(script.hand)) + line("rate", shortest_number(script.rate_hz)) +
                     line("delay", shortest_number(script.delay_s * 1e3)) +
                     line("tremor", shortest_number(script.tremor_mm)) +
                     line("seed", std::to_string(script.seed));
  for (const ScriptStep& step : script.steps) text += "\n[[step]]\n" + std::visit(StepText{}, step);
  return text;
}

}  // namespace palpate
