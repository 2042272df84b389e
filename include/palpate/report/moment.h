#pragma once

#include <array>
#include <memory>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/haptics/haptics.h"
#include "palpate/recording/recording.h"
#include "palpate/rendering/volume_marks.h"

namespace palpate {

/// A moment of a recording, as a picture of the volume shows it.
struct RecordedMoment {
  /// A stretch of a tip's way, in the patient.
  struct Way {
    bool touching = false;
    std::vector<Point<Patient>> points;
  };
  int devices = 1;
  double time_s = 0;  ///< where the tick begins, on the recording's own clock
  TickRecord tick;
  std::vector<Way> ways;       ///< of all devices, in the two seconds before it
  double highest_limit_N = 0;  ///< of the ticks until then
  /// Labels as a burr had left them, and where the tissue was that yields; null: as at the beginning.
  std::shared_ptr<const Model> left;
  /// How far the tissue had gone on which each device's tool leaned.
  std::array<Vector<Patient>, kMaxDevices> dent_mm;
};

/// The last tick that begins at a time or before it; beyond the recording's ends the first or the last one.
/// @param model  as the recording began with
/// Errors: kBadInput where the recording was made with another model or has no ticks, kInterrupted, and those
/// of RecordingSource::read.
Result<RecordedMoment> recorded_moment(const RecordingSource& recording, const Model& model, double time_s,
                                       const Progress& progress = {});

/// Of each device the way, the tool where its proxy is held, in its dent, the tip where the hand was, the
/// proxy, and the force on the hand.
std::vector<VolumeMark> moment_marks(const RecordedMoment& moment, const Model& model,
                                     const VolumeCamera& camera);

}  // namespace palpate
