#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/device/telemetry.h"
#include "palpate/volume/volume.h"

/// What viewers see of tasks and of a run that is under way or over. Structures are labels, which the scene
/// names.
namespace palpate {

/// A task that may be begun.
struct ViewedTask {
  struct Region {
    std::string name;
    std::array<double, 3> middle_mm{};  ///< patient
    double radius_mm = 0;               ///< all of it lies so near to its middle
    std::array<double, 3> outward{};    ///< unit, patient: from where it is seen; zero: from anywhere
    /// What the region is made of, by which the above is computed again on other labels. Told to nobody.
    struct Extent {
      std::vector<LabelId> labels;                                     ///< none: a ball
      std::optional<std::array<double, 3>> centre_mm, landmark, half;  ///< as TaskRegion has them
      double radius_mm = 0;
      struct Plane {
        std::array<double, 3> point_mm{}, normal{};
      };
      std::vector<Plane> planes;  ///< the region lies on the side of each normal
    };
    std::optional<Extent> extent = {};  ///< empty: not known
  };
  struct Step {
    std::string name, kind;  ///< "touch", "visit", "cover", "remove"
    std::size_t region = 0;
    std::array<double, 2> force_N{0, kNotKnown};  ///< of a touch; no number: no bound
    double seconds = 0, coverage = 0;
    bool seen = false;  ///< by the scope
  };
  struct Scope {
    double optics_deg = 0, back_mm = 0;
  };
  struct Force {
    std::vector<LabelId> labels;
    std::optional<std::array<double, 2>> band_N;
    std::optional<double> limit_N;
  };
  struct Protected {
    std::vector<LabelId> labels;
    double limit_N = 0;
  };
  struct Metric {
    std::string name, unit;
    std::vector<LabelId> labels;  ///< none: all
    bool more_is_better = false;
    std::optional<double> at_least, at_most;
    std::string basis;  ///< empty: not validated
  };
  std::string name;  ///< by which it is asked for
  std::string title, briefing;
  bool quiz = false, ordered = false, ends_with_steps = true;
  std::optional<double> time_limit_s, answer_s;
  int in_a_row = 1;
  std::vector<Region> regions;
  std::vector<Step> steps;
  std::vector<Force> forces;
  std::vector<Protected> protections;
  std::vector<Metric> metrics;
  std::vector<LabelId> to_find;
  std::optional<Scope> scope;  ///< in the second device
};

struct ViewedTaskEvent {
  const char* kind = "";  ///< "step_done", "over_limit", "protected", "unseen", "ended"
  std::size_t part = 0;
  double time_s = 0, force_N = 0;
};

/// How far a run is.
struct ViewedTraining {
  enum class Phase : std::uint8_t { kNone, kRunning, kKeeping, kOver };
  static constexpr std::size_t kMostEvents = 8;

  Phase phase = Phase::kNone;
  std::uint32_t run = 0;  ///< its number in the session, from 1; 0: there was none
  std::string task;
  double time_s = 0;
  std::vector<bool> done;     ///< of the steps
  std::vector<double> share;  ///< of each step, 0 ... 1
  std::vector<double> forces_N, protected_N;
  double touch_N = 0;
  bool unseen = false;  ///< something is touched that the scope does not see
  double missing_s = 0;
  std::vector<ViewedTaskEvent> events;  ///< the last ones
  std::uint64_t events_before = 0;      ///< that came before these
  bool keeps =
      false;  ///< the run under way, or the next one of the session's own learner, is kept in records
  std::string learner;  ///< whose the run is, a pseudonym, which is told to nobody; empty: nobody's
};

/// A run that is over.
struct ViewedDebriefing {
  static constexpr std::size_t kMostEvents = 500, kMostPatches = 4000, kMostForces = 4;

  std::uint32_t run = 0;
  std::string task;
  std::string end;  ///< "task", "asked", "session", "trouble"
  bool in_band = false;
  double time_s = 0, missing_s = 0;
  std::uint64_t ticks = 0, first_tick = 0, last_tick = 0;
  struct Metric {
    double value = kNotKnown, best = kNotKnown;
    bool in_band = false;
  };
  std::vector<Metric> metrics;
  std::vector<bool> done;
  std::vector<ViewedTaskEvent> events;  ///< the first ones
  std::uint64_t more_events = 0;
  struct Sample {
    double time_s = 0;
    std::array<double, 3> tip_mm{kNotKnown, kNotKnown, kNotKnown};  ///< patient
    double touch_N = 0;                                             ///< on all that is touched
    std::array<double, kMostForces> forces_N{};                     ///< on the first of the forces
  };
  std::size_t forces = 0;  ///< that samples have
  std::vector<Sample> samples;
  struct Patch {
    std::array<double, 3> middle_mm{};
    bool covered = false;
  };
  std::vector<Patch> patches;
  std::uint64_t patches_left_out = 0;
  std::optional<std::array<double, 3>> answer_mm, to_find_mm;
  int runs = 0, in_a_row = 0;
  std::optional<std::int64_t> kept;
  std::optional<Error> not_kept;
  std::string learner;  ///< whose the run was, as ViewedTraining has it
};

/// A run is to begin, or to end.
struct TaskRequest {
  std::optional<std::string> begin;
  bool end = false;
  std::string learner = {};  ///< whose run it is to be; empty: the session's own learner's
};

}  // namespace palpate
