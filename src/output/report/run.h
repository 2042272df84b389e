#pragma once

#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/contact/model.h"
#include "palpate/recording/recording.h"
#include "palpate/recording/recording_source.h"
#include "palpate/tissue/tissue_laws.h"
#include "report/contacts.h"
#include "report/decimate.h"
#include "report/loop_figures.h"
#include "report/overlay.h"
#include "report/removal_figures.h"

namespace palpate::report {

/// Maximum number of structures with their own sections.
inline constexpr std::size_t kMaxShown = 8;

/// Number of plotted quantities per device.
inline constexpr std::size_t kQuantities = 4;

/// A contact with its own sections.
struct ShownContact {
  Contact contact;
  TickRecord peak;  ///< Tick with the largest force
  std::vector<PathSection> paths;

  const DeviceTick& at_peak() const { return peak.device[static_cast<std::size_t>(contact.device)]; }
};

/// A recording with all figures that the sections of the page need. Refers to the source and the model that
/// it was read from.
struct Run {
  /// Creates an empty run.
  Run(const RecordingHead& recording_in, const Model& model_in)
      : recording(recording_in),
        model(model_in),
        laws(model_in.tissue_law),
        devices(device_count(recording_in)) {}

  const RecordingHead& recording;
  const Model& model;
  LawHistory laws;   ///< Law of soft tissue by model version
  int devices;       ///< 1 ... 4, clamped in case the file is damaged
  TickRecord first;  ///< First tick, if any
  double duration_s = 0;
  std::vector<Contact> contacts;
  std::vector<StructureFigures> structures;
  std::vector<DeepFigures> beneath;
  std::vector<ShownContact> shown;                   ///< One contact per structure, with sections
  RecordingSummary summary;                          ///< Counted from the ticks if the recording is truncated
  TickCount interventions{intervention_flags(), 0};  ///< Ticks with an intervention of the safety stage
  TickCount invalid{kFlagNotFinite | kFlagRotationIgnored, 0};
  TickCount other{intervention_flags() & ~(kFlagClamped | kFlagNotFinite | kFlagRotationIgnored), 0};
  ForceExtremes forces;
  SpreadMeter lateness, compute;
  TickRateMeter rate;
  RemovalFigures removal;  ///< Empty if no burr was used
  /// For each device limit, force, depth and speed; then, on the real clock, the lateness in microseconds.
  PlotData plots;
  /// With deformable tissue: structures that contributed to the force; for each its contribution, summed over
  /// devices, then for each the maximum length of the penetration path within it. At the times of `plots`.
  std::vector<LabelId> layer_labels;
  PlotData layers;

  /// Unknown if the patient orientation of the volume is unknown, whatever the scene states.
  Side side() const { return model.oriented ? model.side : Side::kUnknown; }
  /// Whether the member of the same meaning (in_front, depth_has_gaps, deeper_than_measured) is set for any
  /// of `structures`.
  bool touched_in_front() const;
  bool depth_has_gaps() const;
  bool deeper_than_measured() const;
  bool is_deformable() const { return laws.any(is_elastic); }
  bool real_clock() const { return recording.header.clock == "real"; }
  /// Whether the device was a viewer's pointer, which sends no poses while it is not pressed.
  bool by_pointer() const { return recording.header.device == "pointer"; }
  std::uint32_t intervention_flags() const {
    return by_pointer() ? kInterventionFlags & ~std::uint32_t{kFlagStale} : kInterventionFlags;
  }
  /// Name in the recording, otherwise in the model, otherwise "label 12".
  std::string name(LabelId label) const;
  /// Colour in the model, as in the sections, otherwise in the recording.
  Rgb colour(LabelId label) const;
};

/// Reads the recording in two passes: figures, then the paths of the shown contacts. Errors: those of reading
/// it.
Result<Run> read_run(const RecordingSource& recording, const Model& model, const Progress& progress);

/// HTML of a small square in a structure's colour.
std::string swatch(const Rgb& colour);

}  // namespace palpate::report
