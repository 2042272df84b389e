#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "palpate/device/session_settings.h"
#include "palpate/device/telemetry.h"
#include "palpate/server/viewed_training.h"
#include "palpate/volume/bricks.h"
#include "palpate/volume/volume.h"

/// Data that viewers receive once, because they are constant during a session or a recording.
namespace palpate {

/// Tissue of the scene.
struct ViewedTissue {
  std::string name;
  /// Whether the tissue renders contact.
  bool touchable = true;
  Rgb colour;
  double opacity = 1;
  /// Indices of the tissues that support this one.
  std::vector<int> rests_on;
  std::string protection = "none";  ///< Protection from a burr: "none", "alarm" or "keep"
};
/// Structure of the label map.
struct ViewedStructure {
  LabelId label = 0;
  std::string name;
  Rgb colour;
  int tissue = -1;                   ///< Index of its tissue; -1: none
  std::vector<LabelId> within = {};  ///< Labels of the structures in which it is nested (Model::enclosing)
};
/// Known limitation of the model (Caveat), shown as a warning.
struct ViewedCaveat {
  std::string concerns;  ///< Its subject: "placement", "side" or "force"
  std::string text;      ///< Caveat::text
};
/// Recording as shown on a time line. Times are those of the recording.
struct ViewedRecording {
  std::uint64_t ticks = 0;
  double begin_s = 0, end_s = 0;  ///< Times of the first and the last tick
  struct Contact {
    double begin_s = 0, end_s = 0;
    LabelId label = 0;
    double max_N = 0;  ///< Maximum force during the contact
    int device = 0;    ///< Index of the recording's device
  };
  std::vector<Contact> contacts;  ///< Contacts of all devices, by begin
  /// Number of omitted contacts; the shortest are omitted if there are too many
  std::uint64_t omitted_contacts = 0;
  struct Event {
    double time_s = 0;
    std::string kind;                  ///< "stop", "rearm", "settings", "model"
    std::vector<std::string> changed;  ///< "settings": names of changed settings, or "pointer"
    int tissue = -1;           ///< "model": index of the changed tissue; -1 if the fields were regenerated
    std::string by;            ///< Originator: "viewer", "key", "script" or "session"
    std::uint32_t viewer = 0;  ///< Number of the viewer, if a viewer requested it
  };
  std::vector<Event> events;
  /// Number of omitted events: beyond the maximum, or without a tick in which they took effect.
  std::uint64_t omitted_events = 0;
  std::vector<double> force_N;  ///< Maximum force of any device within each of equal tick intervals
};

/// Tool of a device.
struct ViewedTool {
  std::string name;
  double radius_mm = 0;
  bool cuts = false;  ///< Whether it has a motor
  /// Shape of a burr's head: "ball", "cylinder" or "cone"; empty: not a burr
  std::optional<std::string> burr;
  std::vector<std::array<double, 3>> points_mm;
  struct Capsule {
    std::array<double, 3> from_mm, to_mm;     ///< Ends of its axis, in the tip's frame
    double radius_mm = 0, end_radius_mm = 0;  ///< Radii at either end; linear in between
  };
  std::vector<Capsule> capsules;  ///< Head of a burr that is not a ball
  bool shaver = false;            ///< Whether a cutting tool is called a shaver rather than a burr
  double revolutions_per_s = 0;   ///< Rotation rate of a burr while its motor runs; 0: not a burr
  int flutes = 0;                 ///< Number of a burr's cutting edges; 0: not a burr
};
/// Calls `of(name, value)` for every member of a tool as viewers get it. Messages and the page's types are
/// derived from it; a member that it does not bind fails to compile.
template <class Visit>
void visit_fields(const ViewedTool& tool, Visit&& of) {
  const auto& [name, radius_mm, cuts, burr, points_mm, capsules, shaver, revolutions_per_s, flutes] = tool;
  of("name", name);
  of("radius_mm", radius_mm);
  of("cuts", cuts);
  of("burr", burr);
  of("points_mm", points_mm);
  of("capsules", capsules);
  of("shaver", shaver);
  of("revolutions_per_s", revolutions_per_s);
  of("flutes", flutes);
}
template <class Visit>
void visit_fields(const ViewedTool::Capsule& capsule, Visit&& of) {
  const auto& [from_mm, to_mm, radius_mm, end_radius_mm] = capsule;
  of("from_mm", from_mm);
  of("to_mm", to_mm);
  of("radius_mm", radius_mm);
  of("end_radius_mm", end_radius_mm);
}

/// Forbidden region.
struct ViewedNoGo {
  struct Plane {
    /// Patient frame; unit normal, pointing to the permitted side
    std::array<double, 3> point_mm{}, outward{};
  };
  struct Ball {
    std::array<double, 3> centre_mm{};  ///< Patient frame
    double radius_mm = 0;
  };
  std::string name;
  double keep_away_mm = 0;                   ///< Distance from the region at which the force begins
  std::variant<LabelId, Plane, Ball> shape;  ///< A structure, the half-space behind a plane, or a ball
};

/// Scene data that is constant during a session. Apart from the names of structures and tissues it contains
/// no patient data.
struct ViewedScene {
  std::string side = "unknown";  ///< "left", "right", "both", "unknown"
  bool oriented = true;
  std::vector<ViewedCaveat> caveats;
  std::string modality = "unknown";               ///< "ct", "mr", "unknown"
  std::uint64_t content_hash = 0;                 ///< Hash of scan and labels; changes with any voxel
  std::shared_ptr<const Volume<float>> scan;      ///< May be null
  std::shared_ptr<const Bricks<LabelId>> labels;  ///< Never null
  std::array<double, 2> window{0, 1};             ///< Initial display window of the scan
  /// Homogeneous matrix, row-major, translation in mm.
  std::array<std::array<double, 4>, 4> world_from_patient{};
  std::vector<ViewedStructure> structures;
  std::vector<ViewedTissue> tissues;
  std::vector<ViewedTool> tools;     ///< Tool of each device; never empty
  std::vector<std::string> methods;  ///< Force methods that can be chosen
  std::vector<std::string> laws;     ///< Tissue laws that can be chosen; none without soft tissue
  std::string device_name;
  bool simulated = true;
  /// Source of the tip's motion: "script", "pointer", "ros2", "device", "recording"
  std::string input = "script";
  /// Ratings of the first device; kNoValue: unknown.
  double peak_force_N = kNoValue, continuous_force_N = kNoValue, max_stiffness_N_per_mm = kNoValue;
  ValueRange max_force_range{};  ///< Range of the user's force limit; N
  double rate_hz = 1000;
  std::optional<ViewedRecording> recording;  ///< Recording shown in place of a session
  std::vector<ViewedTask> tasks;             ///< Tasks that may be begun
  /// Distance within which ticks report the distance to a structure; empty: ticks report none.
  std::optional<double> distance_reach_mm;
  std::vector<ViewedNoGo> no_go;  ///< In the order of the indices in DeviceTick::no_go

  /// Whether ticks report distances or no-go regions.
  bool reports_distances() const { return distance_reach_mm.has_value() || !no_go.empty(); }
};

}  // namespace palpate
