#pragma once

#include <algorithm>
#include <limits>

#include "palpate/device/device_parameters.h"
#include "palpate/device/telemetry.h"
#include "palpate/device/workspace.h"

namespace palpate {

/// What a hand feels of a stiffness by a device: scale x force gain x the tissue's, because a millimetre of
/// the device is `scale` in the patient and a newton there is `force_gain` at the device; and no more than
/// the hand holds with the device. Dampings, N s/mm, go the same way. By the proxy every tissue is capped for
/// itself, by the direct methods all are softer by one factor, since one field has all of them.
class FeltStiffness {
 public:
  /// As the scene asks for it, not capped.
  explicit FeltStiffness(const WorkspaceSettings& settings)
      : FeltStiffness(settings.scale, settings.force_gain, std::numeric_limits<double>::infinity()) {}
  explicit FeltStiffness(const DeviceParameters& device)
      : FeltStiffness(device.scale, device.force_gain, device.most_stiffness_N_per_mm) {}
  /// As it was felt in that tick.
  explicit FeltStiffness(const DeviceTick& device)
      : FeltStiffness(device.scale, device.force_gain, device.most_stiffness_N_per_mm) {}

  /// What `patient_N_per_mm` in the patient is at the device, not capped.
  double at_device(double patient_N_per_mm) const { return factor_ * patient_N_per_mm; }
  /// What `device_N_per_mm` at the device is in the patient.
  double in_patient(double device_N_per_mm) const { return device_N_per_mm / factor_; }
  /// N/mm in the patient that are felt at most: at least 0; not a number where nothing is known of it, which
  /// caps nothing.
  double most_in_patient() const {
    const double most = in_patient(most_N_per_mm_);
    return most < 0 ? 0 : most;
  }
  /// What the proxy makes of a tissue, N/mm at the device.
  double by_proxy(double patient_N_per_mm) const {
    return std::min(at_device(patient_N_per_mm), most_N_per_mm_);
  }
  /// What the direct methods leave of every stiffness, 0 ... 1.
  /// @param all_N_per_mm  in the patient: the stiffest tissue's, of all points of the tool together
  double left_of_all(double all_N_per_mm) const { return std::min(1.0, most_in_patient() / all_N_per_mm); }

 private:
  FeltStiffness(double scale, double force_gain, double most_N_per_mm)
      : factor_(scale * force_gain), most_N_per_mm_(most_N_per_mm) {}

  double factor_;
  double most_N_per_mm_;  // at the device
};

}  // namespace palpate
