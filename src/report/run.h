#pragma once

#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/haptics/haptics.h"
#include "palpate/recording/recording.h"
#include "palpate/tissue/tissue_laws.h"
#include "report/contacts.h"
#include "report/decimate.h"
#include "report/loop_figures.h"
#include "report/overlay.h"
#include "report/removal_figures.h"

namespace palpate::report {

/// How many structures get sections of their own.
inline constexpr std::size_t kMaxShown = 8;

/// Quantities of each device that are plotted.
inline constexpr std::size_t kQuantities = 4;

/// A contact with sections of its own.
struct ShownContact {
  Contact contact;
  TickRecord peak;  ///< with the largest force
  std::vector<Way> ways;

  const DeviceTick& at_peak() const { return peak.device[static_cast<std::size_t>(contact.device)]; }
};

/// A recording with everything that the parts of the page are told about it. Refers to the source and the
/// model that it was read from.
struct Run {
  /// With nothing in it yet.
  Run(const RecordingHead& recording_in, const Model& model_in)
      : recording(recording_in),
        model(model_in),
        laws(model_in.tissue_law),
        devices(device_count(recording_in)) {}

  const RecordingHead& recording;
  const Model& model;
  LawHistory laws;   ///< of soft tissue
  int devices;       ///< 1 ... 4, whatever a damaged file says
  TickRecord first;  ///< the first tick, where there is one
  double duration_s = 0;
  std::vector<Contact> contacts;
  std::vector<StructureFigures> structures;
  std::vector<BeneathFigures> beneath;
  std::vector<ShownContact> shown;                   ///< one contact a structure, with sections
  RecordingSummary summary;                          ///< counted from the ticks when the run was cut short
  TickCount interventions{intervention_flags(), 0};  ///< of the safety stage
  TickCount invalid{kFlagNotFinite | kFlagRotationIgnored, 0};
  TickCount other{intervention_flags() & ~(kFlagClamped | kFlagNotFinite | kFlagRotationIgnored), 0};
  ForceExtremes forces;
  SpreadMeter lateness, compute;
  RateOfTicks rate;
  RemovalFigures removal;  ///< empty where no burr was at work
  /// Of each device limit, force, depth and speed, then, on the real clock, the lateness in microseconds.
  PlotData plots;
  /// Where tissue yields: structures that were felt, and of each the force that it gave, all devices
  /// together, then of each the most of a tip's way in that lay within it. On the times of `plots`.
  std::vector<LabelId> layer_labels;
  PlotData layers;

  /// Unknown when it is not known how the volume lies in the patient, whatever the scene says.
  Side side() const { return model.oriented ? model.side : Side::kUnknown; }
  /// Of any structure.
  bool felt_in_front() const;
  bool depth_has_gaps() const;
  bool deeper_than_measured() const;
  bool yields() const { return laws.any(is_elastic); }
  bool real_clock() const { return recording.header.clock == "real"; }
  /// A viewer's pointer was the device: it says nothing while nobody presses it.
  bool by_pointer() const { return recording.header.device == "pointer"; }
  std::uint32_t intervention_flags() const {
    return by_pointer() ? kInterventionFlags & ~std::uint32_t{kFlagStale} : kInterventionFlags;
  }
  /// The name in the recording, else in the model, else "label 12".
  std::string name(LabelId label) const;
  /// The colour in the model, which the sections show, else in the recording.
  Rgb colour(LabelId label) const;
};

/// Reads the recording twice: what happened, then the ways of the contacts that are shown. Errors: those of
/// reading it.
Result<Run> read_run(const RecordingSource& recording, const Model& model, const Progress& progress);

/// A small square of a structure's colour.
std::string swatch(const Rgb& colour);

}  // namespace palpate::report
