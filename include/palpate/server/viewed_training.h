#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/device/telemetry.h"
#include "palpate/volume/volume.h"

/// Tasks, progress of a run and its debriefing, as published to viewers. Structures are given as labels,
/// which the scene names.
namespace palpate {

/// Task that may be begun.
struct ViewedTask {
  struct Region {
    std::string name;
    std::array<double, 3> centre_mm{};  ///< Centre, patient frame
    double radius_mm = 0;               ///< Radius of a sphere about the centre that contains the region
    /// Unit vector, patient frame: side from which the region is visible; zero: any
    std::array<double, 3> outward{};
    /// Definition of the region, from which the members above are recomputed for other labels. Not published.
    struct Extent {
      std::vector<LabelId> labels;                                     ///< None: a sphere
      std::optional<std::array<double, 3>> centre_mm, landmark, half;  ///< As in TaskRegion
      double radius_mm = 0;
      struct Plane {
        std::array<double, 3> point_mm{}, normal{};
      };
      std::vector<Plane> planes;  ///< The region lies on the positive side of each plane
    };
    std::optional<Extent> extent = {};  ///< Empty: unknown
  };
  struct Step {
    std::string name, kind;  ///< "touch", "visit", "cover", "remove"
    std::size_t region = 0;
    std::array<double, 2> force_N{0, kNoValue};  ///< Force range of a touch; NaN: unbounded
    double seconds = 0, coverage = 0;
    bool in_scope_view = false;  ///< Whether the region also has to be in the scope's view
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
    std::vector<LabelId> labels;  ///< None: all structures
    bool more_is_better = false;
    std::optional<double> at_least, at_most;
    std::string basis;  ///< Validation basis of the bounds; empty: not validated
  };
  std::string name;  ///< Name by which viewers request it
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
  std::optional<Scope> scope;  ///< Scope held by the second device
};

struct ViewedTaskEvent {
  const char* kind = "";  ///< "step_done", "over_limit", "protected", "unseen", "ended"
  std::size_t part = 0;
  double time_s = 0, force_N = 0;
};

/// Progress of a run.
struct ViewedTraining {
  enum class Phase : std::uint8_t { kNone, kRunning, kStoring, kOver };
  static constexpr std::size_t kMaxEvents = 8;

  Phase phase = Phase::kNone;
  std::uint32_t run = 0;  ///< Number within the session, from 1; 0: no run yet
  std::string task;
  double time_s = 0;
  std::vector<bool> done;        ///< Per step: whether it is done
  std::vector<double> fraction;  ///< Progress of each step, 0 ... 1
  std::vector<double> forces_N, protected_N;
  double touch_N = 0;
  bool unseen = false;  ///< Whether a structure outside the scope's view is in contact
  double missing_s = 0;
  std::vector<ViewedTaskEvent> events;  ///< Most recent events
  std::uint64_t events_before = 0;      ///< Number of events before these
  /// Whether the current run, or the next run of the session's own learner, is stored in the records
  bool is_stored = false;
  std::string learner;  ///< Pseudonym of the run's learner, not published; empty: none
};

/// Result of a finished run.
struct ViewedDebriefing {
  static constexpr std::size_t kMaxEvents = 500, kMaxPatches = 4000, kMaxForces = 4;

  std::uint32_t run = 0;
  std::string task;
  std::string end;  ///< Reason for the end: "task", "asked", "session", "trouble"
  bool in_band = false;
  double time_s = 0, missing_s = 0;
  std::uint64_t ticks = 0, first_tick = 0, last_tick = 0;
  struct Metric {
    double value = kNoValue, best = kNoValue;
    bool in_band = false;
  };
  std::vector<Metric> metrics;
  std::vector<bool> done;
  std::vector<ViewedTaskEvent> events;  ///< Earliest events
  std::uint64_t more_events = 0;
  struct Sample {
    double time_s = 0;
    std::array<double, 3> tip_mm{kNoValue, kNoValue, kNoValue};  ///< Patient frame
    double touch_N = 0;                                          ///< Total contact force
    /// Contact force per measured force of the task, for the first of them
    std::array<double, kMaxForces> forces_N{};
  };
  std::size_t forces = 0;  ///< Number of valid entries of Sample::forces_N
  std::vector<Sample> samples;
  struct Patch {
    std::array<double, 3> centre_mm{};
    bool covered = false;
  };
  std::vector<Patch> patches;
  std::uint64_t omitted_patches = 0;
  std::optional<std::array<double, 3>> answer_mm, to_find_mm;
  int runs = 0, in_a_row = 0;
  std::optional<std::int64_t> run_id;
  std::optional<Error> not_stored;
  std::string learner;  ///< Pseudonym of the run's learner, as in ViewedTraining
};

/// Request to begin or end a run.
struct TaskRequest {
  std::optional<std::string> begin;
  bool end = false;
  std::string learner = {};  ///< Pseudonym of the run's learner; empty: the session's own learner
};

}  // namespace palpate
