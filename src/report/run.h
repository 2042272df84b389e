#pragma once

#include <string>
#include <vector>

#include "palpate/haptics.h"
#include "palpate/recording.h"
#include "report/contacts.h"

namespace palpate::report {

/// How many structures get sections of their own.
inline constexpr std::size_t kMostShown = 8;

/// A recording with everything that the parts of the page are told about it. Refers to both arguments.
struct Run {
  Run(const Recording& recording_in, const Model& model_in);

  const Recording& recording;
  const Model& model;
  std::vector<double> edges_s;
  std::vector<Contact> contacts;
  std::vector<StructureFigures> structures;
  std::vector<Contact> shown;   ///< one contact a structure, with sections
  RecordingSummary summary;     ///< counted from the ticks when the run was cut short
  std::uint64_t interventions;  ///< ticks in which the safety stage intervened
  ForceExtremes forces;

  /// Unknown when it is not known how the volume lies in the patient, whatever the scene says.
  Side side() const { return model.oriented ? model.side : Side::kUnknown; }
  /// Of any structure.
  bool felt_in_front() const;
  bool depth_has_gaps() const;
  bool deeper_than_measured() const;
  bool real_clock() const { return recording.header.clock == "real"; }
  double duration_s() const { return edges_s.back() - edges_s.front(); }
  const DeviceTick& at_peak(const Contact& contact) const {
    return recording.ticks[contact.peak].device[contact.device];
  }
  /// The name in the recording, else in the model, else "label 12".
  std::string name(LabelId label) const;
  /// The colour in the model, which the sections show, else in the recording.
  Rgb colour(LabelId label) const;
};

/// A small square of a structure's colour.
std::string swatch(const Rgb& colour);

}  // namespace palpate::report
