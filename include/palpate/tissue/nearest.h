#pragma once

#include <array>
#include <map>
#include <vector>

#include "palpate/device/telemetry.h"
#include "palpate/haptics/haptics.h"
#include "palpate/tissue/carving.h"

namespace palpate {

/// Whether the motor of any device's burr was switched on in a tick, by its switch or a pedal. Of other
/// tools: no.
bool motor_was_on(const Model& model, const TickRecord& tick);

/// How near any device's burr came to each structure that is protected, while it turned: from its head to the
/// structure as prepared, 0 where it touched that or cut it. What was undone counts too. A structure has no
/// figure while the head stayed beyond the reach of its distances, in a session 10 mm from the middle of a
/// ball, of a cylinder or cone from its axis.
class NearestMeter {
 public:
  /// @param model  with nothing taken from it; its protected structures prepared (ready_for)
  explicit NearestMeter(const Model& model);

  /// Where it was held in a tick, whether it cut or only leaned on something.
  void see(const TickRecord& tick);
  /// What it cut: beneath other layers it goes deeper than the tick tells.
  void see(const Sweep& sweep);
  /// What another meter has seen of the same structures.
  void see(const std::map<LabelId, double>& nearest_mm);

  const std::map<LabelId, double>& nearest_mm() const { return nearest_mm_; }

 private:
  void see(const Point<Patient>& at, double radius_mm, const ProtectedStructure& structure);
  Vector<Patient> row_mm(const BurrSettings& burr, const TickRecord& tick, const DeviceTick& device) const;

  std::array<Tool, kMaxDevices> tools_;  // that the devices hold
  Transform<World, Patient> X_WorldPatient_;
  std::vector<ProtectedStructure> protected_;
  std::map<LabelId, double> nearest_mm_;
};

}  // namespace palpate
