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

/// What is drawn over a section, as SVG in the section's pixels.
namespace palpate::report {

/// One stretch of the tip's way, in the patient.
struct Way {
  bool touching = false;
  std::vector<Point<Patient>> points;
};

/// The way of a contact's tip from a second before it to a second after it, cut where the contact
/// begins and ends. A long way keeps every second, fourth, eighth ... of its points, so that it never has
/// more than kMaxWayPoints.
inline constexpr std::size_t kMaxWayPoints = 20'000;
class WayFollower {
 public:
  explicit WayFollower(const Contact& contact) : contact_(contact) {}
  void see(const TimedTick& now);
  std::vector<Way> finish() { return std::move(ways_); }

 private:
  void thin_out();

  Contact contact_;
  std::vector<Way> ways_;
  std::size_t points_ = 0, step_ = 1;  // every step_th tick is kept
};

/// The force sent in one tick, turned from the workspace into the patient as the object was felt then.
Vector<Patient> patient_force_N(const Model& model, const TickRecord& tick, int device);

/// A part of the tool: a sphere, or a capsule or cone with round ends.
struct ToolPart {
  Point<Patient> from;
  double radius_mm = 0;
  Vector<Patient> along_mm = {};  ///< to the other end of its axis; 0: a sphere
  double widens_mm = 0;           ///< by so much its radius is greater there
};
/// A tool as a tick has it, where its proxy is held: on the surface at rest. A burr's row is a part of it.
std::vector<ToolPart> tool_parts(const Model& model, const TickRecord& tick, int device);

struct SectionMarks {
  Point<Patient> contact;
  Vector<Patient> force_N;
  double arrow_mm_per_N = 5;
  Side side = Side::kUnknown;
  std::vector<std::string> doubts;  ///< markup::doubt_marks
  bool oriented = true;             ///< false: how the volume lies in the patient is not known
  std::vector<Way> ways;
  std::vector<ToolPart> tool;  ///< drawn as the plane cuts them
  /// Entry and target of a planned trajectory, which lie in the plane.
  std::optional<std::array<Point<Patient>, 2>> planned = {};
};

/// Ways farther than this from the plane are not drawn.
inline constexpr double kWayReach_mm = 5;

/// Way, tool, contact, force, scale bar, orientation letters, and the side in the lower right corner, where
/// no letter stands that it could be taken for. Without orientation no letter, and a mark that says so.
/// `description` is for those who do not see the picture.
std::string section_svg(const SectionPlane& plane, const SectionMarks& marks, const std::string& description);

}  // namespace palpate::report
