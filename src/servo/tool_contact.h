#pragma once

#include <array>
#include <limits>

#include "palpate/servo/servo.h"

namespace palpate {

/// What one point of the tool meets.
struct PointContact {
  FieldSample sample;
  ContactSite site;
  Vector<Patient> force_N;  ///< surface effects included
  Point<Patient> proxy;     ///< of the tool's origin

  /// Felt, or so deep inside that there is no direction to push in.
  bool is_touch() const;
};

/// A structure along the tip's way in.
struct FeltStructure {
  LabelId label = 0;
  double depth_mm = 0;  ///< of the way that lies within it; NaN: deeper than is measured
  double share = 0;     ///< of the force, 0 ... 1
};

/// What all points of the tool ask for together, multiplied by the device's gains, and the contact that asks
/// for most.
struct ToolContact {
  Wrench asked;
  PointContact strongest;
  /// Outermost first; those after the last have label 0.
  std::array<FeltStructure, kMostTold> felt;
  /// Energy at the device that the contact can hold as a spring does; infinite: not known.
  double stored_mJ = std::numeric_limits<double>::infinity();
  double stiffness_N_per_mm = 0;  ///< of it, at the device, where it is stiffest
  std::uint32_t flags = 0;        ///< of the proxy: kFlagInside, kFlagWedged, kFlagRuptured
  /// The proxy was let go, because what was put back is where it was: the force that it gave fades out.
  bool let_go = false;
};

/// @param tip             where the tool's origin is
/// @param velocity_mm_s   of the tip, relative to the object
ToolContact touch_with_tool(const Model& model, const Parameters& parameters, const DeviceParameters& gains,
                            const Eigen::Quaterniond& R_WorldTool, const Point<Patient>& tip,
                            const Vector<Patient>& velocity_mm_s,
                            const Transform<World, Patient>& X_WorldPatient,
                            const Transform<Patient, World>& X_PatientWorld);

/// What has changed since the last tick of the proxy.
struct ProxyChange {
  bool surfaces = false;                  ///< it is on those of another version of the model
  std::span<const SurfaceBefore> before;  ///< these, one for each of the model's
  bool method = false;       ///< a direct method pushed until now: where the tip is inside, a proxy is born
  std::uint64_t carved = 0;  ///< so many sweeps of the tool's burr are taken from the surfaces
};

/// What runs a burr in a tick.
struct MotorState {
  bool runs = false;
  double most_press_N = 0;   ///< in the patient
  std::uint32_t stroke = 0;  ///< of what it cuts
};

/// The same by the proxy, which remembers where it is, and by a burr, which takes away what it touches.
/// Friction is its own, viscosity that of the direct methods.
ToolContact touch_by_proxy(const Model& model, const Parameters& parameters, const DeviceParameters& gains,
                           const Eigen::Quaterniond& R_WorldTool, const Point<Patient>& tip,
                           const Vector<Patient>& velocity_mm_s,
                           const Transform<World, Patient>& X_WorldPatient,
                           const Transform<Patient, World>& X_PatientWorld, double dt_s,
                           const ProxyChange& change, const MotorState& motor, SessionState::Hand& hand);

}  // namespace palpate
