#include "palpate/navigation/point_files.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <set>

#include "palpate/base/printable.h"
#include "palpate/json/json.h"

namespace palpate {
namespace {

constexpr std::size_t kMaxPoints = 100'000;

std::string_view trimmed_text(std::string_view text) {
  constexpr std::string_view kBlank = " \t\r\n";
  const std::size_t first = text.find_first_not_of(kBlank);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kBlank) - first + 1);
}

std::optional<double> number_of(std::string_view text) {
  text = trimmed_text(text);
  if (text.starts_with('+')) text.remove_prefix(1);
  double value = 0;
  const auto [end, failed] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (failed != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) return {};
  return value;
}

// splits a line by the first of these separators that occurs in it; consecutive blanks count as one
std::vector<std::string_view> cells_of(std::string_view line) {
  std::vector<std::string_view> cells;
  for (const char part : {',', ';', '\t'}) {
    if (line.find(part) == std::string_view::npos) continue;
    for (std::size_t from = 0; from <= line.size();) {
      const std::size_t to = std::min(line.find(part, from), line.size());
      cells.push_back(trimmed_text(line.substr(from, to - from)));
      from = to + 1;
    }
    if (cells.back().empty()) cells.pop_back();  // trailing separator
    if (part != '\t' || cells.size() > 2) return cells;
    cells.clear();
  }
  for (std::size_t from = line.find_first_not_of(" \t"); from < line.size();) {
    const std::size_t to = std::min(line.find_first_of(" \t", from), line.size());
    cells.push_back(line.substr(from, to - from));
    from = line.find_first_not_of(" \t", to);
  }
  return cells;
}

struct Line {
  std::size_t number = 0;
  std::string_view text;
};
std::vector<Line> lines_of(std::string_view text) {
  std::vector<Line> lines;
  std::size_t number = 0;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    ++number;
    if (const std::string_view line = trimmed_text(text.substr(0, end)); !line.empty())
      lines.push_back({number, line});
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return lines;
}

Error bad(std::string what, const std::string& where, std::string remedy) {
  return {ErrorKind::kBadInput, std::move(what), where, std::move(remedy)};
}
std::string at_line(const std::string& where, const Line& line) {
  return where + ":" + std::to_string(line.number);
}

bool says_lps(std::string_view says) {
  return says == "LPS" || says == "1";
}
bool says_ras(std::string_view says) {
  return says == "RAS" || says == "0";
}
Eigen::Vector3d to_lps(const Eigen::Vector3d& ras) {
  return {-ras.x(), -ras.y(), ras.z()};
}

constexpr const char* kMarkupsRemedy =
    "save the points again as 3D Slicer markups (.mrk.json), or as lines of name, x, y, z";

/// A control point with a defined position; empty otherwise.
/// @param number  index within its file, from 1
Result<std::optional<NamedPoint>> control_point(const Json& control, std::size_t number, bool is_ras,
                                                const std::string& where) {
  if (!control.is_object()) return bad("a control point is not an object", where, kMarkupsRemedy);
  if (const Json* status = control.find("positionStatus"); status != nullptr && *status != "defined")
    return std::optional<NamedPoint>();
  const Json* position = control.find("position");
  if (position == nullptr || !position->is_array() || position->size() != 3 ||
      !std::all_of(position->begin(), position->end(), [](const Json& each) { return each.is_number(); }))
    return bad("control point " + std::to_string(number) + " has no position of three numbers", where,
               kMarkupsRemedy);
  const Eigen::Vector3d at((*position)[0].get<double>(), (*position)[1].get<double>(),
                           (*position)[2].get<double>());
  if (!at.allFinite())
    return bad("control point " + std::to_string(number) + " has no finite position", where, kMarkupsRemedy);
  std::string name;
  if (const Json* label = control.find("label"); label != nullptr && label->is_string())
    name = label->get<std::string>();
  return std::optional(
      NamedPoint{name.empty() ? std::to_string(number) : name, is_ras ? to_lps(at) : at, {}});
}

// the unit is a word, or a word with its code: ["mm", "UCUM", "millimeter"]
Result<void> check_millimetres(const Json& markup, const std::string& where) {
  const Json* unit = markup.find("coordinateUnits");
  if (unit == nullptr) return {};
  const Json& word = unit->is_array() && !unit->empty() ? unit->front() : *unit;
  if (word == "mm") return {};
  return bad(
      "its coordinates are in " + printable_name(word.is_string() ? word.get<std::string>() : word.dump()),
      where, "save them in millimetres (mm)");
}

std::string text_in(const Json& markup, const char* key) {
  const Json* text = markup.find(key);
  return text != nullptr && text->is_string() ? text->get<std::string>() : "";
}

}  // namespace

Result<std::vector<Markup>> parse_markups(std::string_view text, const std::string& where) {
  const std::optional<Json> json = Json::parse(text);
  if (!json || !json->is_object())
    return bad("is not a JSON file of 3D Slicer markups", where, kMarkupsRemedy);
  const Json* markups = json->find("markups");
  if (markups == nullptr || !markups->is_array() || markups->empty())
    return bad("has no markups", where, kMarkupsRemedy);
  std::vector<Markup> found;
  std::size_t points = 0;
  for (const Json& markup : *markups) {
    if (!markup.is_object()) continue;
    Markup& made = found.emplace_back(Markup{text_in(markup, "type"), text_in(markup, "name"), {}});
    const Json* controls = markup.find("controlPoints");
    if (controls == nullptr || !controls->is_array()) continue;
    std::string axes = "LPS";
    if (const Json* says = markup.find("coordinateSystem"))
      axes = says->is_string() ? says->get<std::string>() : says->dump();
    if (!says_lps(axes) && !says_ras(axes))
      return bad("its coordinate system is \"" + printable_name(axes) + "\"", where,
                 "LPS and RAS are supported");
    if (auto known = check_millimetres(markup, where); !known) return known.error();
    for (const Json& control : *controls) {
      auto point = control_point(control, points + 1, says_ras(axes), where);
      if (!point) return point.error();
      if (!*point) continue;
      if (points++ == kMaxPoints)
        return bad("has more than 100 000 points", where, "leave out points that are not needed");
      made.points.push_back(**std::move(point));
    }
  }
  return found;
}

Result<std::vector<NamedPoint>> parse_points(std::string_view text, const std::string& where) {
  if (trimmed_text(text).starts_with('{')) {
    auto markups = parse_markups(text, where);
    if (!markups) return markups.error();
    std::vector<NamedPoint> points;
    for (Markup& markup : *markups)
      for (NamedPoint& point : markup.points) points.push_back(std::move(point));
    if (points.empty()) return bad("has no placed point", where, kMarkupsRemedy);
    return points;
  }
  const char* kRemedy = "write one line per point: name, x, y, z in millimetres";
  // columns of Slicer's .fcsv: id, x, y, z, four of an orientation, three flags, the label
  constexpr std::size_t kFcsvLabel = 11;
  bool is_fcsv = false, is_ras = false, may_be_heading = true;
  std::vector<NamedPoint> points;
  for (const Line& line : lines_of(text)) {
    if (line.text.starts_with('#')) {
      if (line.text.find("Markups fiducial file") != std::string_view::npos) is_fcsv = is_ras = true;
      if (const std::size_t at = line.text.find("CoordinateSystem ="); at != std::string_view::npos) {
        const std::string_view axes = trimmed_text(line.text.substr(at + 18));
        if (!says_lps(axes) && !says_ras(axes))
          return bad("its coordinate system is \"" + printable_name(axes) + "\"", at_line(where, line),
                     "LPS and RAS are supported");
        is_ras = says_ras(axes);
      }
      continue;
    }
    const std::vector<std::string_view> cells = cells_of(line.text);
    // a name may be a number: three cells are coordinates, and with more the first one is the name
    const bool is_named = is_fcsv || cells.size() > 3;
    const std::size_t first = is_named ? 1 : 0;
    std::vector<double> numbers;
    for (std::size_t n = first; n < std::min(cells.size(), first + (is_fcsv ? 3 : 5)); ++n)
      if (const auto number = number_of(cells[n]))
        numbers.push_back(*number);
      else
        break;
    const bool is_whole = is_fcsv ? numbers.size() == 3
                                  : numbers.size() + first == cells.size() &&
                                        (numbers.size() == 3 || (is_named && numbers.size() == 4));
    if (!is_whole) {
      if (std::exchange(may_be_heading, false) && numbers.empty() && cells.size() >= 3) continue;
      return bad("is not a point", at_line(where, line), kRemedy);
    }
    may_be_heading = false;
    if (numbers.size() == 4 && !(numbers[3] > 0))
      return bad("the point's error must be above 0", at_line(where, line),
                 "give it in millimetres, or leave it out");
    if (points.size() == kMaxPoints)
      return bad("has more than 100 000 points", where, "leave out points that are not needed");
    std::string_view name = is_fcsv    ? (cells.size() > kFcsvLabel ? cells[kFcsvLabel] : "")
                            : is_named ? cells[0]
                                       : "";
    NamedPoint point{name.empty() ? std::to_string(points.size() + 1) : std::string(name),
                     {numbers[0], numbers[1], numbers[2]},
                     {}};
    if (is_ras) point.at_mm = to_lps(point.at_mm);
    if (numbers.size() == 4) point.fle_mm = numbers[3];
    points.push_back(std::move(point));
  }
  if (points.empty()) return bad("has no point", where, kRemedy);
  return points;
}

namespace {

using Pose = Transform<Tracker, TrackedTool>;

// invalid rotations are reported by calibrate_pivot with their number
std::optional<Pose> pose_of(std::span<const double> n, bool scalar_first) {
  if (n.size() == 7) {
    const Eigen::Quaterniond q = scalar_first ? Eigen::Quaterniond(n[3], n[4], n[5], n[6])
                                              : Eigen::Quaterniond(n[6], n[3], n[4], n[5]);
    if (std::abs(q.norm() - 1) > 0.01) return {};
    return Pose(q.normalized().toRotationMatrix(), {n[0], n[1], n[2]});
  }
  if (n.size() != 12 && n.size() != 16) return {};
  if (n.size() == 16 && (n[12] != 0 || n[13] != 0 || n[14] != 0 || n[15] != 1)) return {};
  Eigen::Matrix3d rotation;
  rotation << n[0], n[1], n[2], n[4], n[5], n[6], n[8], n[9], n[10];
  return Pose(rotation, {n[3], n[7], n[11]});
}

std::optional<std::vector<double>> numbers_of(const std::vector<std::string_view>& cells) {
  std::vector<double> numbers;
  for (const std::string_view cell : cells) {
    const auto number = number_of(cell);
    if (!number) return {};
    numbers.push_back(*number);
  }
  return numbers;
}

// header lines such as "Seq_Frame0012_StylusToTrackerTransform = 1 0 0 ..." and "...TransformStatus = OK"
Result<std::vector<Pose>> plus_sequence(std::string_view text, const std::string& where,
                                        const PoseFormat& format) {
  std::set<std::string, std::less<>> names;
  std::map<std::string, std::pair<Line, std::string_view>, std::less<>> frames;
  std::set<std::string, std::less<>> invalid;
  for (const Line& line : lines_of(text)) {
    const std::size_t is = line.text.find('=');
    if (is == std::string_view::npos) continue;
    const std::string_view key = trimmed_text(line.text.substr(0, is)),
                           value = trimmed_text(line.text.substr(is + 1));
    // image data follow
    if (key == "ElementDataFile") break;
    if (!key.starts_with("Seq_Frame")) continue;
    const std::size_t part = key.find('_', 9);
    if (part == std::string_view::npos) continue;
    const std::string_view frame = key.substr(9, part - 9), field = key.substr(part + 1);
    const bool says_status = field.ends_with("TransformStatus");
    if (!says_status && !field.ends_with("Transform")) continue;
    const std::string name(field.substr(0, field.size() - (says_status ? 15 : 9)));
    if (!says_status) names.insert(name);
    if (!format.transform.empty() && name != format.transform) continue;
    if (says_status && value != "OK") invalid.emplace(frame);
    if (!says_status) frames.insert_or_assign(std::string(frame), std::pair(line, value));
  }
  std::string known;
  for (const std::string& name : names) known += (known.empty() ? "" : ", ") + printable_name(name);
  if (format.transform.empty() && names.size() > 1)
    return bad("has several transforms: " + known, where, "choose one with --transform");
  if (frames.empty())
    return bad("has no transform" +
                   (format.transform.empty() ? std::string() : " " + printable_name(format.transform)),
               where, known.empty() ? "also record the tool's transforms" : "it has: " + known);
  std::vector<Pose> poses;
  for (const auto& [frame, at] : frames) {
    if (invalid.contains(frame)) continue;
    const auto numbers = numbers_of(cells_of(at.second));
    const auto pose = numbers && numbers->size() == 16 ? pose_of(*numbers, false) : std::nullopt;
    if (!pose)
      return bad("is not a matrix of 16 numbers", at_line(where, at.first), "record the sequence again");
    if (poses.size() == kMaxPoints)
      return bad("has more than 100 000 poses", where, "leave out points that are not needed");
    poses.push_back(*pose);
  }
  if (poses.empty()) return bad("has no valid pose", where, "keep the tool in view of the tracker");
  return poses;
}

}  // namespace

Result<std::vector<Transform<Tracker, TrackedTool>>> parse_poses(std::string_view text,
                                                                 const std::string& where,
                                                                 const PoseFormat& format) {
  if (text.starts_with("ObjectType")) return plus_sequence(text, where, format);
  const char* kRemedy =
      "write one line per pose: 16 or 12 numbers of a matrix row by row, or x y z and a unit quaternion";
  std::vector<Pose> poses;
  bool may_be_heading = true;
  for (const Line& line : lines_of(text)) {
    if (line.text.starts_with('#')) continue;
    const auto cells = cells_of(line.text);
    const auto numbers = numbers_of(cells);
    if (!numbers && std::exchange(may_be_heading, false) && !number_of(cells[0])) continue;
    may_be_heading = false;
    const auto pose = numbers ? pose_of(*numbers, format.scalar_first) : std::nullopt;
    if (!pose) return bad("is not a pose", at_line(where, line), kRemedy);
    if (poses.size() == kMaxPoints)
      return bad("has more than 100 000 poses", where, "leave out points that are not needed");
    poses.push_back(*pose);
  }
  if (poses.empty()) return bad("has no pose", where, kRemedy);
  return poses;
}

}  // namespace palpate
