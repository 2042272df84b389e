#pragma once

#include <algorithm>
#include <limits>

#include "palpate/device/device_parameters.h"
#include "palpate/device/telemetry.h"
#include "palpate/device/workspace.h"

namespace palpate {

/// Conversion of a tissue's stiffness to the stiffness rendered at a device: scale x force gain x stiffness,
/// because one device millimetre is `scale` patient millimetres and one patient newton is `force_gain` device
/// newtons; clamped to the largest stiffness that the operator can hold with the device. Dampings (N s/mm)
/// convert the same way. The proxy clamps every tissue separately; the direct methods scale all tissues by
/// one factor, because a single field contains all of them.
class RenderedStiffness {
 public:
  /// Gains of the scene, without clamping.
  explicit RenderedStiffness(const WorkspaceSettings& settings)
      : RenderedStiffness(settings.scale, settings.force_gain, std::numeric_limits<double>::infinity()) {}
  explicit RenderedStiffness(const DeviceParameters& device)
      : RenderedStiffness(device.scale, device.force_gain, device.max_stiffness_N_per_mm) {}
  /// Gains that were in effect in a recorded tick.
  explicit RenderedStiffness(const DeviceTick& device)
      : RenderedStiffness(device.scale, device.force_gain, device.max_stiffness_N_per_mm) {}

  /// Converts `patient_N_per_mm` in the patient to the device, without clamping.
  double at_device(double patient_N_per_mm) const { return factor_ * patient_N_per_mm; }
  /// Converts `device_N_per_mm` at the device to the patient.
  double in_patient(double device_N_per_mm) const { return device_N_per_mm / factor_; }
  /// Largest stiffness in the patient that is rendered unclamped, N/mm, at least 0. NaN if unknown, which
  /// does not clamp.
  double max_in_patient() const {
    const double largest = in_patient(max_N_per_mm_);
    return largest < 0 ? 0 : largest;
  }
  /// Stiffness that the proxy renders for a tissue, N/mm at the device.
  double by_proxy(double patient_N_per_mm) const {
    return std::min(at_device(patient_N_per_mm), max_N_per_mm_);
  }
  /// Factor by which the direct methods scale every stiffness, 0 ... 1.
  /// @param all_N_per_mm  stiffness in the patient of the stiffest tissue, summed over all points of the tool
  double direct_method_factor(double all_N_per_mm) const {
    return std::min(1.0, max_in_patient() / all_N_per_mm);
  }

 private:
  RenderedStiffness(double scale, double force_gain, double max_N_per_mm)
      : factor_(scale * force_gain), max_N_per_mm_(max_N_per_mm) {}

  double factor_;
  double max_N_per_mm_;  // at the device
};

}  // namespace palpate
