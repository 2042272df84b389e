#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "palpate/contact/proxy.h"

/// Instruments: geometry and burr settings.
namespace palpate {

/// Maximum radius of a tool's sphere or capsule, that of a finger.
inline constexpr double kMaxToolRadius_mm = 12;

/// A capsule of a tool, for a shaft or a hook: a cylinder with hemispherical ends.
struct ToolCapsule {
  Eigen::Vector3d from_mm, to_mm;  ///< End points of the axis in the tip's frame; distinct
  double radius_mm = 0;
};

/// Burr settings of a tool (palpate/tissue/removal.h): a rotating head that removes the tissue it touches.
/// The head is the tool's sphere (a ball), or a row of balls that starts with it.
struct BurrSettings {
  double revolutions_per_s = 1000;      ///< Rotation rate while the motor runs; above 0
  double grip = 0.5;                    ///< As Burr::grip
  Eigen::Vector3d spindle = {0, 0, 1};  ///< Axis of rotation in the tip's frame; unit
  int pedal = -1;                       ///< Button of the device that runs the motor while pressed. -1: none
  /// Burr::length_mm: distance between the first and last centre of the row. 0: a ball.
  double length_mm = 0;
  double end_radius_mm = 0;  ///< As Burr::end_radius_mm
  bool shaver = false;       ///< Whether it is a shaver for soft tissue; affects the name only
  int flutes = 8;            ///< Number of cutting edges around the head; at least 1
  bool irrigation = true;    ///< Whether the head is cooled; otherwise the heating of the bone is estimated
};

/// Geometry of the instrument: spheres and capsules fixed in the tip's frame. A point tool is one sphere of
/// radius 0 at the origin. Direct methods evaluate the spheres' centres, the proxy uses the whole geometry.
struct Tool {
  std::string name = "point";
  /// Sphere centres in the tip's frame; 1 ... kMaxToolParts.
  std::vector<Eigen::Vector3d> points_mm{Eigen::Vector3d::Zero()};
  double radius_mm = 0;               ///< Radius of every sphere
  std::vector<ToolCapsule> capsules;  ///< Capsules; at most kMaxToolParts together with the spheres
  /// Burr settings. If set, the tool is a single sphere at the origin, from which the burr's row extends, and
  /// the removal is rendered by the proxy only.
  std::optional<BurrSettings> burr;

  /// Whether the burr's motor runs.
  /// @param switched_on  state of the motor's switch
  /// @param buttons      button bit mask of the tool's device
  bool motor_is_on(bool switched_on, std::uint32_t buttons) const {
    return burr && (switched_on || (burr->pedal >= 0 && (buttons >> burr->pedal & 1u) != 0));
  }
};

/// Shape of the burr: "ball", "cylinder" or "cone". Empty: the tool is not a burr.
std::string burr_shape(const Tool& tool);
/// Name of the burr: "burr" or "shaver". Empty: the tool is neither.
std::string cutter_name(const Tool& tool);
/// Description such as "burr: a cone of 2.3 mm, 1.2 mm at its tip, 8 mm long". Empty: the tool is no burr.
std::string burr_description(const Tool& tool);

}  // namespace palpate
