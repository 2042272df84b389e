#pragma once

#include <memory>
#include <optional>

#include "palpate/base/progress.h"
#include "palpate/recording/recording_source.h"
#include "palpate/scene/scene.h"
#include "palpate/server/viewer_host.h"
#include "palpate/session/shared_plan.h"
#include "palpate/session/training.h"

/// Playback of a recording to viewers: random access, at any speed, forwards and backwards.
///
///    clock ── position ──► block of 4096 ticks ──► last tick not after it ──► viewers
///                               ▲
///                 a thread reads the requested block, then the next one in the direction of playback
///
/// If soft tissue deforms, a second thread solves it again at the displayed position from the ticks that it
/// was originally solved from (docs/concepts/tissue.md, "Playback"): the pose is shown immediately,
/// the deformation once it is solved.
namespace palpate {

struct Model;

/// Task whose run the recording is shown as.
struct PlayedTaskOptions {
  OfferedTask task;
  TickRange ticks;  ///< Ticks of the run
};

/// Scans the whole recording once, to build its time line and the volume that a burr had removed at each
/// position, and starts paused at the beginning. Every pose shown is a recorded tick with all its values;
/// while a block is being read the previous tick stays visible. Requests that only a live session can fulfil
/// are refused; a stop pauses playback, since no force is rendered.
/// @param modality  modality that the scene declares
/// @param task      task whose progress at the displayed position is shown, and whose debriefing follows at
///                  its end
/// @param plan      plan shown along with the recording; may be null
/// Errors: those of resolve_task() and TaskEvaluator::observe(); kBadInput if the run contains no tick, if
/// the recording is of another scene, has no ticks, or its clock is not monotonic; those of
/// RecordingSource::read; kUnavailable if no thread can be created.
Result<std::unique_ptr<PlaybackHost>> open_playback(RecordingSource recording,
                                                    std::shared_ptr<const Model> model, Modality modality,
                                                    const Progress& progress = {},
                                                    std::optional<PlayedTaskOptions> task = {},
                                                    std::shared_ptr<SharedPlan> plan = {});

}  // namespace palpate
