#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "palpate/recording/recording.h"
#include "palpate/rendering/rendering.h"
#include "report/contacts.h"

/// SVG overlay of a section, in the pixel coordinates of the section.
namespace palpate::report {

/// A section of the tip's path, patient frame.
struct PathSection {
  bool touching = false;
  std::vector<Point<Patient>> points;
};

/// Maximum number of points of a path drawn over a section.
inline constexpr std::size_t kMaxOverlayPoints = 20'000;

/// Path of the tip from a second before a contact to a second after it, split where the contact begins and
/// ends. Long paths are decimated to every second, fourth, eighth ... point, so that there are at most
/// kMaxOverlayPoints.
class PathRecorder {
 public:
  explicit PathRecorder(const Contact& contact) : contact_(contact) {}
  void observe(const TimedTick& now);
  std::vector<PathSection> finish() { return std::move(sections_); }

 private:
  void thin_out();

  Contact contact_;
  std::vector<PathSection> sections_;
  std::size_t points_ = 0, step_ = 1;  // every step_-th tick is kept
};

/// Force sent in one tick, rotated from world into the patient frame by the object's rotation in that tick.
Vector<Patient> patient_force_N(const Model& model, const TickRecord& tick, int device);

/// A collision primitive of the tool: a sphere, or a capsule or cone with round ends.
struct OverlayPart {
  Point<Patient> from;
  double radius_mm = 0;
  Vector<Patient> along_mm = {};  ///< Vector to the other end of the axis; 0: a sphere
  double radius_change_mm = 0;    ///< Radius at the other end minus radius_mm
};
/// Tool primitives of a tick at the proxy, i.e. on the surface of the undeformed tissue. The row of a burr is
/// one primitive.
std::vector<OverlayPart> overlay_parts(const Model& model, const TickRecord& tick, int device);

struct SectionMarks {
  Point<Patient> contact;
  Vector<Patient> force_N;
  double arrow_mm_per_N = 5;
  Side side = Side::kUnknown;
  std::vector<std::string> doubts;  ///< From markup::doubt_marks
  bool oriented = true;             ///< Whether the patient orientation of the volume is known
  std::vector<PathSection> paths;
  std::vector<OverlayPart> tool;  ///< Drawn as intersections with the plane
  /// Entry and target of a planned trajectory; both in the plane.
  std::optional<std::array<Point<Patient>, 2>> planned = {};
};

/// Maximum distance from the plane at which paths are drawn.
inline constexpr double kPathReach_mm = 5;

/// Path, tool, contact, force, scale bar, orientation letters, and the side in the lower right corner, where
/// it cannot be mistaken for an orientation letter. Without a known orientation a mark replaces the letters.
/// `description` is the alternative text for screen readers.
std::string section_svg(const SectionPlane& plane, const SectionMarks& marks, const std::string& description);

}  // namespace palpate::report
