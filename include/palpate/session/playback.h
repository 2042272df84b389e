#pragma once

#include <memory>
#include <optional>

#include "palpate/base/progress.h"
#include "palpate/link/viewer_server.h"
#include "palpate/recording/recording.h"
#include "palpate/scene/scene.h"
#include "palpate/session/shared_plan.h"
#include "palpate/session/training.h"

/// A recording as viewers look at it: any place of it, at any speed, forwards and backwards.
///
///     clock ── place ──► block of 4096 ticks ──► the tick that held there ──► viewers
///                              ▲
///                  a thread reads the one that is wanted, then the next on the way
///
/// Where soft tissue yields another thread solves it anew at the place that is shown, from the ticks that it
/// was solved from (docs/concepts/tissue.md, "Looked at again"): the place stands at once, the dent when it
/// is solved.
namespace palpate {

struct Model;

/// A task that a recording is looked at as a run of.
struct PlayedTaskOptions {
  OfferedTask task;
  TickRange ticks;  ///< that are the run
};

/// Looks through all of the recording once, for its time line and for what a burr took away up to each of its
/// places, and stands at its beginning, not playing. Every pose is a tick of the recording, in all its
/// numbers; while a place is being read the last one stands. What is asked of a session is refused, and a
/// stop ends the playing: nothing pushes.
/// @param modality  as the scene says it
/// @param task      viewers see how far it was at the place that is shown, and its debriefing after its end
/// @param plan      that is shown beside it; may be null
/// Errors: those of look_up() and TaskEvaluator::see(), kBadInput where no tick is of the run; kBadInput for
/// another scene's recording, one without ticks or whose clock does not rise; those of RecordingSource::read;
/// kUnavailable where there is no thread to be had.
Result<std::unique_ptr<ViewerHost>> open_playback(RecordingSource recording,
                                                  std::shared_ptr<const Model> model, Modality modality,
                                                  const Progress& progress = {},
                                                  std::optional<PlayedTaskOptions> task = {},
                                                  std::shared_ptr<SharedPlan> plan = {});

}  // namespace palpate
