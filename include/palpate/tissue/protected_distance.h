#pragma once

#include <array>
#include <map>
#include <vector>

#include "palpate/contact/model.h"
#include "palpate/device/telemetry.h"
#include "palpate/tissue/carving.h"

namespace palpate {

/// Whether the motor of any device's burr was switched on in a tick, by its switch or a pedal. Always false
/// for other tools.
bool motor_was_on(const Model& model, const TickRecord& tick);

/// Least distance that any device's running burr reached to each protected structure: from its head to the
/// prepared surface, 0 if it touched or cut it. Undone strokes count. A structure has no value if the head
/// stayed beyond the range of its distance field, in a session 10 mm from the centre of a ball or from the
/// axis of a cylinder or cone.
class ProtectedDistanceMeter {
 public:
  /// @param model  with nothing removed; protected structures prepared (prepared_for() in
  ///               palpate/model/make_model.h)
  explicit ProtectedDistanceMeter(const Model& model);

  /// Includes the burr's position in a tick, whether it cut or only touched.
  void observe(const TickRecord& tick);
  /// Includes a completed sweep: in an inner layer the burr cuts deeper than the position reported in the
  /// tick.
  void observe(const Sweep& sweep);
  /// Includes the results of another meter for the same structures.
  void observe(const std::map<LabelId, double>& nearest_mm);

  const std::map<LabelId, double>& nearest_mm() const { return nearest_mm_; }

 private:
  void observe(const Point<Patient>& at, double radius_mm, const ProtectedStructure& structure);
  Vector<Patient> row_mm(const BurrSettings& burr, const TickRecord& tick, const DeviceTick& device) const;

  std::array<Tool, kMaxDevices> tools_;  // tools of the devices
  Transform<World, Patient> X_WorldPatient_;
  std::vector<ProtectedStructure> protected_;
  std::map<LabelId, double> nearest_mm_;
};

}  // namespace palpate
