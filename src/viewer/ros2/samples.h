#pragma once

#include <array>
#include <string>
#include <utility>
#include <vector>

/// Published samples, in the units of ROS 2: metres, seconds, newtons, newton metres, quaternions
/// in the order x, y, z, w.
namespace palpate::ros2 {

/// Frame of poses, twists and wrenches: the patient's, LPS (x left, y posterior, z superior), in metres.
inline constexpr const char* kPatientFrame = "patient_lps";
/// The same origin with axes by REP 103: x anterior, y left, z superior.
inline constexpr const char* kBaseFrame = "patient";

struct PoseSample {
  std::array<double, 3> position_m{};
  std::array<double, 4> orientation_xyzw{0, 0, 0, 1};
};

inline constexpr double kMetre_mm = 1000;

/// One device in one tick. NaN: unknown.
struct HandSample {
  PoseSample tool;   ///< Tip and orientation of the tool: measured_cp
  PoseSample proxy;  ///< Position of the proxy and orientation of the tool: setpoint_cp
  std::array<double, 3> velocity_m_s{}, angular_velocity_rad_s{};  ///< measured_cv
  std::array<double, 3> force_N{}, torque_Nm{};  ///< Wrench on the hand, about the tip: measured_cf
  /// Structures near the tool, nearest first, and distances from the tool's outline, negative inside; m.
  std::vector<std::pair<std::string, double>> distances;
  std::string no_go;  ///< No-go region that the tool is deepest in; empty: none
  double no_go_depth_m = 0, no_go_N = 0;
};

}  // namespace palpate::ros2
