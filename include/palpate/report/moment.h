#pragma once

#include <array>
#include <memory>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/contact/model.h"
#include "palpate/recording/recording_source.h"
#include "palpate/rendering/volume_marks.h"

namespace palpate {

/// State of a recording at one time, for rendering in a picture of the volume.
struct RecordedMoment {
  /// A section of a tip's path, patient frame.
  struct PathSection {
    bool touching = false;
    std::vector<Point<Patient>> points;
  };
  int devices = 1;
  double time_s = 0;  ///< Start of the tick, on the recording's clock
  TickRecord tick;
  std::vector<PathSection> paths;  ///< Paths of all devices during the two seconds before the tick
  double highest_limit_N = 0;      ///< Highest force limit of the ticks up to this one
  /// Model with the labels as cut by burrs and displaced by tissue deformation; null: unchanged since the
  /// start.
  std::shared_ptr<const Model> current_model;
  /// Displacement of deformable tissue at each device's contact point.
  std::array<Vector<Patient>, kMaxDevices> dent_mm;
};

/// State at the last tick that begins at or before a time; clamped to the first and last tick of the
/// recording.
/// @param model  model at the start of the recording
/// Errors: kBadInput if the recording was made with another model or has no ticks, kInterrupted, and those of
/// RecordingSource::read.
Result<RecordedMoment> recorded_moment(const RecordingSource& recording, const Model& model, double time_s,
                                       const Progress& progress = {});

/// Graphic marks of each device: path, tool at its proxy (displaced with the deformed tissue), the tip as
/// held by the operator, the proxy, and the force on the operator's hand.
std::vector<VolumeMark> moment_marks(const RecordedMoment& moment, const Model& model,
                                     const VolumeCamera& camera);

}  // namespace palpate
