#include "report/overlay.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "palpate/contact/recorded_pose.h"
#include "report/html.h"

namespace palpate::report {
namespace {

constexpr double kPathMargin_s = 1.0;
constexpr double kScaleBar_mm = 10;
constexpr double kMinStep_px = 0.7;  // between drawn points of a path
constexpr double kMinArrow_px = 5;   // a shorter arrow is drawn end-on

struct Pixel {
  double x = 0, y = 0;
};

// the centre of pixel (0,0) is at (0.5, 0.5) in the drawing
Pixel to_drawing(const SectionPlane& plane, const Point<Patient>& p) {
  const auto [column, row] = plane.pixel_of(p);
  return {column + 0.5, row + 0.5};
}

std::string pair(const Pixel& p) {
  return number(p.x, 1) + "," + number(p.y, 1);
}

std::string line(const std::string& css_class, const Pixel& a, const Pixel& b) {
  return "<line class=\"" + css_class + "\" x1=\"" + number(a.x, 1) + "\" y1=\"" + number(a.y, 1) +
         "\" x2=\"" + number(b.x, 1) + "\" y2=\"" + number(b.y, 1) + "\"/>";
}

std::string text(const std::string& css_class, const Pixel& at, const std::string& content) {
  return "<text class=\"" + css_class + "\" x=\"" + number(at.x, 1) + "\" y=\"" + number(at.y, 1) + "\">" +
         escape(content) + "</text>";
}

/// Path with a dark halo, for contrast on every structure.
std::string polyline(bool touching, const std::vector<Pixel>& points) {
  if (points.size() < 2) return "";
  std::string list;
  for (const Pixel& p : points) {
    if (!list.empty()) list += ' ';
    list += pair(p);
  }
  std::string svg = "<polyline class=\"halo\" points=\"";
  svg.append(list).append("\"/><polyline class=\"").append(touching ? "way touching" : "way");
  return svg.append("\" points=\"").append(list).append("\"/>");
}

/// Sections of a path near the plane and within the picture, without points too close to distinguish.
std::string draw_path(const SectionPlane& plane, const PathSection& section) {
  const Vector<Patient> normal = plane.right.cross(plane.down);
  std::string svg;
  std::vector<Pixel> run;
  for (const Point<Patient>& point : section.points) {
    const Pixel p = to_drawing(plane, point);
    const bool near = std::abs((point - plane.centre).dot(normal)) <= kPathReach_mm;
    const bool in_picture = p.x >= 0 && p.y >= 0 && p.x <= plane.width_px && p.y <= plane.height_px;
    if (!near || !in_picture) {
      svg += polyline(section.touching, run);
      run.clear();
    } else if (run.empty() || std::hypot(p.x - run.back().x, p.y - run.back().y) >= kMinStep_px) {
      run.push_back(p);
    }
  }
  return svg + polyline(section.touching, run);
}

/// Symbol of a vector perpendicular to the plane: a circle with a dot (towards the viewer) or a cross (away).
std::string draw_end_on(const Pixel& tip, bool away) {
  const Pixel at{tip.x + 16, tip.y - 16};
  const std::string centre = "cx=\"" + number(at.x, 1) + "\" cy=\"" + number(at.y, 1) + "\"";
  std::string svg = "<circle class=\"end-on\" " + centre + " r=\"6.5\"/>";
  if (!away) return svg + "<circle class=\"force-head\" " + centre + " r=\"2.2\"/>";
  constexpr double kArm = 4;
  return svg + line("force", {at.x - kArm, at.y - kArm}, {at.x + kArm, at.y + kArm}) +
         line("force", {at.x - kArm, at.y + kArm}, {at.x + kArm, at.y - kArm});
}

std::string draw_force(const SectionPlane& plane, const SectionMarks& marks) {
  if (!(marks.force_N.norm() > 0)) return "";
  const double px_per_N = marks.arrow_mm_per_N / plane.mm_per_px();
  const double x = marks.force_N.dot(plane.right) * px_per_N, y = marks.force_N.dot(plane.down) * px_per_N;
  const double length = std::hypot(x, y);
  const Pixel tail = to_drawing(plane, marks.contact);
  if (length < kMinArrow_px) return draw_end_on(tail, marks.force_N.dot(plane.right.cross(plane.down)) > 0);

  // the shaft ends at the base of the head
  const double ux = x / length, uy = y / length, head = std::min(11.0, 0.6 * length);
  const Pixel tip{tail.x + x, tail.y + y}, base{tip.x - ux * head, tip.y - uy * head};
  const double half = 0.45 * head;
  const Pixel left{base.x - uy * half, base.y + ux * half}, right{base.x + uy * half, base.y - ux * half};
  return line("force-halo", tail, base) + line("force", tail, base) +
         "<polygon class=\"force-head\" points=\"" + pair(tip) + " " + pair(left) + " " + pair(right) +
         "\"/>";
}

std::string draw_contact(const SectionPlane& plane, const Point<Patient>& contact) {
  const Pixel p = to_drawing(plane, contact);
  const std::string centre = "cx=\"" + number(p.x, 1) + "\" cy=\"" + number(p.y, 1) + "\"";
  return "<circle class=\"contact-halo\" " + centre + " r=\"6\"/><circle class=\"contact\" " + centre +
         " r=\"6\"/><circle class=\"tip\" " + centre + " r=\"1.8\"/>";
}

/// Intersection of a tool primitive with the plane: the convex hull of the circles in which the plane cuts
/// spheres along the axis. The hull is exact because the primitive is convex.
std::string draw_tool(const SectionPlane& plane, const OverlayPart& part) {
  constexpr int kSteps = 64, kAround = 96;
  const Vector<Patient> normal = plane.right.cross(plane.down);
  struct Cut {
    Pixel middle;
    double radius_px;
  };
  std::vector<Cut> cuts;
  const int steps = part.along_mm.norm() > 0 ? kSteps : 0;
  for (int n = 0; n <= steps; ++n) {
    const double at = steps == 0 ? 0 : static_cast<double>(n) / steps;
    const Point<Patient> centre = part.from + part.along_mm * at;
    const double off = (centre - plane.centre).dot(normal),
                 radius = part.radius_mm + part.radius_change_mm * at;
    if (radius * radius > off * off)
      cuts.push_back({to_drawing(plane, centre), std::sqrt(radius * radius - off * off) / plane.mm_per_px()});
  }
  if (cuts.empty()) return "";
  std::string shape;
  if (steps == 0) {
    const Cut& cut = cuts.front();
    shape = "cx=\"" + number(cut.middle.x, 1) + "\" cy=\"" + number(cut.middle.y, 1) + "\" r=\"" +
            number(cut.radius_px, 1) + "\"/>";
    return "<circle class=\"tool-halo\" " + shape + "<circle class=\"tool\" " + shape;
  }
  for (int n = 0; n < kAround; ++n) {
    const double turn = 2 * std::numbers::pi * n / kAround, x = std::cos(turn), y = std::sin(turn);
    const auto reach = [&](const Cut& cut) { return x * cut.middle.x + y * cut.middle.y + cut.radius_px; };
    const Cut& farthest = *std::ranges::max_element(cuts, {}, reach);
    shape += (n == 0 ? "" : " ") +
             pair({farthest.middle.x + x * farthest.radius_px, farthest.middle.y + y * farthest.radius_px});
  }
  shape = "points=\"" + shape + "\"/>";
  return "<polygon class=\"tool-halo\" " + shape + "<polygon class=\"tool\" " + shape;
}

/// Trajectory with a bar across it at the entry and a ring around the target.
std::string draw_planned(const SectionPlane& plane, const std::array<Point<Patient>, 2>& planned) {
  constexpr double kBar_px = 7;
  const Pixel entry = to_drawing(plane, planned[0]), target = to_drawing(plane, planned[1]);
  const double length = std::max(1.0, std::hypot(target.x - entry.x, target.y - entry.y));
  const Pixel across{kBar_px * (entry.y - target.y) / length, kBar_px * (target.x - entry.x) / length};
  const Pixel left{entry.x - across.x, entry.y - across.y}, right{entry.x + across.x, entry.y + across.y};
  const std::string ring = "cx=\"" + number(target.x, 1) + "\" cy=\"" + number(target.y, 1) + "\" r=\"7\"/>";
  std::string svg;
  for (const std::string kind : {"planned-halo", "planned"})
    svg += line(kind, entry, target) + line(kind, left, right) + "<circle class=\"" + kind + "\" " + ring;
  return svg;
}

std::string draw_scale_bar(const SectionPlane& plane) {
  const double length = kScaleBar_mm / plane.mm_per_px();
  const Pixel left{14, plane.height_px - 16.0}, right{left.x + length, left.y};
  std::string svg;
  for (const std::string kind : {"scale-halo", "scale"}) {
    svg += line(kind, left, right) + line(kind, {left.x, left.y - 4}, {left.x, left.y + 4}) +
           line(kind, {right.x, right.y - 4}, {right.x, right.y + 4});
  }
  return svg + text("scale-text", {0.5 * (left.x + right.x), left.y - 8}, number(kScaleBar_mm, 0) + " mm");
}

std::string draw_letters(const SectionPlane& plane) {
  const OrientationLetters letters = orientation_letters(plane);
  const double width = plane.width_px, height = plane.height_px;
  return text("letter start", {9, 0.5 * height + 6}, letters.left) +
         text("letter end", {width - 9, 0.5 * height + 6}, letters.right) +
         text("letter", {0.5 * width, 22}, letters.top) +
         text("letter", {0.5 * width, height - 10}, letters.bottom);
}

}  // namespace

void PathRecorder::observe(const TimedTick& now) {
  if (now.begin_s < contact_.begin_s - kPathMargin_s || now.begin_s > contact_.end_s + kPathMargin_s) return;
  const DeviceTick& device = now.tick.device[contact_.device];
  const Point<Patient> tip(device.tip_patient_mm[0], device.tip_patient_mm[1], device.tip_patient_mm[2]);
  if (!tip.all_finite() || (device.flags & kFlagNotFinite) != 0) return;
  const bool touching = now.index >= contact_.first && now.index <= contact_.last;
  const bool turn = sections_.empty() || sections_.back().touching != touching;
  // the ends of a section are kept, and every step_-th tick between them
  if (!turn && now.index % step_ != 0 && now.index != contact_.last) return;
  if (turn) {
    // adjacent sections share a point
    PathSection next{touching, {}};
    if (!sections_.empty()) next.points.push_back(sections_.back().points.back());
    sections_.push_back(std::move(next));
  }
  sections_.back().points.push_back(tip);
  if (++points_ >= kMaxOverlayPoints) thin_out();
}

void PathRecorder::thin_out() {
  step_ *= 2;
  points_ = 0;
  for (PathSection& section : sections_) {
    std::vector<Point<Patient>> thinned;
    for (std::size_t i = 0; i < section.points.size(); ++i)
      if (i % 2 == 0 || i + 1 == section.points.size()) thinned.push_back(section.points[i]);
    points_ += thinned.size();
    section.points = std::move(thinned);
  }
}

Vector<Patient> patient_force_N(const Model& model, const TickRecord& tick, int device) {
  const auto& f = tick.device[device].force_N;
  return in_patient(model.X_WorldPatient, tick, Vector<World>(f[0], f[1], f[2]));
}

std::vector<OverlayPart> overlay_parts(const Model& model, const TickRecord& tick, int device) {
  const DeviceTick& device_tick = tick.device[device];
  const Tool& tool = model.tool_of(static_cast<std::size_t>(device));
  const Point<Patient> proxy(device_tick.proxy_patient_mm[0], device_tick.proxy_patient_mm[1],
                             device_tick.proxy_patient_mm[2]);
  const auto& w = device_tick.orientation_wxyz;
  const Eigen::Quaterniond rotation(w[0], w[1], w[2], w[3]);
  std::vector<OverlayPart> parts;
  if (!proxy.all_finite() || !rotation.coeffs().allFinite() || !(rotation.squaredNorm() > 0)) return parts;
  const auto turned = [&](const Eigen::Vector3d& of_tool) {
    return tool_in_patient(model.X_WorldPatient, tick, device_tick, of_tool);
  };
  for (const Eigen::Vector3d& point : tool.points_mm)
    parts.push_back({proxy + turned(point), tool.radius_mm});
  for (const ToolCapsule& capsule : tool.capsules)
    parts.push_back(
        {proxy + turned(capsule.from_mm), capsule.radius_mm, turned(capsule.to_mm - capsule.from_mm)});
  if (tool.burr && tool.burr->length_mm > 0) {
    parts.front().along_mm = turned(tool.burr->spindle * tool.burr->length_mm);
    parts.front().radius_change_mm = tool.burr->end_radius_mm - tool.radius_mm;
  }
  return parts;
}

std::string section_svg(const SectionPlane& plane, const SectionMarks& marks,
                        const std::string& description) {
  std::string svg = "<svg viewBox=\"0 0 " + std::to_string(plane.width_px) + " " +
                    std::to_string(plane.height_px) + "\" role=\"img\" aria-label=\"" + escape(description) +
                    "\"><g class=\"marks\">";
  if (marks.planned) svg += draw_planned(plane, *marks.planned);
  // contact sections are drawn on top
  for (const bool touching : {false, true}) {
    for (const PathSection& section : marks.paths) {
      if (section.touching == touching) svg += draw_path(plane, section);
    }
  }
  for (const OverlayPart& part : marks.tool) svg += draw_tool(plane, part);
  svg += draw_force(plane, marks) + draw_contact(plane, marks.contact) + "</g>";
  svg += draw_scale_bar(plane);
  if (marks.oriented) svg += draw_letters(plane);
  std::vector<std::string> corner = marks.doubts;
  if (const std::string side = markup::side_mark(marks.side, marks.oriented); !side.empty())
    corner.push_back(side);
  constexpr double kLine_px = 16;
  double base_px = plane.height_px - 12.0 + kLine_px;
  for (auto line = corner.rbegin(); line != corner.rend(); ++line)
    svg += text("side-mark", {plane.width_px - 10.0, base_px -= kLine_px}, *line);
  return svg + "</svg>\n";
}

}  // namespace palpate::report
