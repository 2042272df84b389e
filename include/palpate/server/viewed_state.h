#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/device/session_settings.h"
#include "palpate/device/telemetry.h"
#include "palpate/volume/volume.h"

/// State that viewers receive whenever it changes.
namespace palpate {

/// Estimated error of a tracked tool's displayed tip.
struct ViewedNavigation {
  int device = 0;  ///< Index of the tracked device
  /// Whether the tracker currently sees the tool; if not, the tip stays at its last position
  bool is_visible = true;
  double fre_mm = 0;  ///< Fiducial registration error
  struct Error {
    double rms_mm = 0, max_mm = 0;  ///< Root mean square, and 95th percentile
    bool is_far = false;            ///< Whether the tip is far outside the registration's points
  };
  std::optional<Error> tip;  ///< Empty: unknown
};

/// Timing of the loop over the last second, and totals since it began.
struct ViewedHealth {
  double rate_hz = 0;
  /// Lateness of ticks and compute time per tick over the last second: quantiles and maximum.
  double lateness_p50_us = 0, lateness_p99_us = 0, lateness_max_us = 0, compute_p50_us = 0;
  /// Totals since the loop began.
  std::uint64_t skipped = 0, dropped = 0, stalls = 0;
};

/// Originator of a stop.
enum class StoppedBy : std::uint8_t {
  kSession,  ///< The session itself, when its supervisor was missing
  kKey,      ///< A key where palpate runs
  kViewer,
};
/// Session state that may change at any time.
struct ViewedState : Settings {
  std::string method_awaited;  ///< Method that becomes active once its fields are generated; empty: none
  /// Reason why the method requested last could not be prepared; Error::where is its name.
  std::optional<Error> method_failure;
  std::string law;          ///< Law of soft tissue
  std::string law_awaited;  ///< Law that becomes active once its surfaces are built; empty: none
  /// Reason why the law requested last could not be prepared; Error::where is its name.
  std::optional<Error> law_failure;
  /// Edge length of the cells in which the law solves soft tissue, and the length that the scene requests,
  /// mm: a machine that is too slow solves in coarser ones. 0: the law solves none.
  double law_cell_mm = 0, requested_cell_mm = 0;
  bool motor_is_on = false;              ///< Whether a motor runs, by its switch or a pedal
  std::uint64_t sweeps = 0;              ///< Number of burr sweeps removed from the labels
  std::vector<std::uint64_t> undone_to;  ///< Number of sweeps left after each undo so far
  std::size_t strokes_to_undo = 0, strokes_to_redo = 0;
  std::map<LabelId, double> removed_mm3;  ///< Volume removed by the sweeps, per structure
  double broken_off_mm3 = 0;              ///< Part of it that was not cut, but cut loose: fragments
  /// Smallest distance to each protected structure (ProtectedDistanceMeter).
  std::map<LabelId, double> nearest_mm;
  std::uint32_t model_version = 1;
  std::vector<ContactProperties> tissues;  ///< Current properties of each tissue
  /// Number of the stop in effect (Arming::number), to which a rearm refers; empty: the force is not stopped.
  std::optional<std::uint32_t> stop;
  StoppedBy stopped_by = StoppedBy::kSession;  ///< Originator of that stop
  std::uint32_t stopped_by_viewer = 0;         ///< ViewerIdentity::number, if a viewer stopped the force
  bool armed = false;                          ///< Whether a physical device can apply force
  bool recording = false;
  /// Playback of a recording.
  struct Playback {
    bool playing = false;
    double speed = 1;
    std::optional<Error> failure;  ///< Reason why no more of it can be shown
  };
  std::optional<Playback> playback;
  /// A teacher's choices.
  struct Lesson {
    std::string learner;   ///< Pseudonym of the runs' learner; empty: none
    std::string task;      ///< ViewedTask::name of the only task that may be begun; empty: any
    bool is_over = false;  ///< Whether a teacher has ended the session, which closes shortly
    /// Whether a run may be begun as that learner.
    bool is_for(const std::string& other) const { return learner.empty() || learner == other; }
  };
  Lesson lesson;
};

/// Displacement field of soft tissue around a device's tool, on a regular grid.
struct ViewedDeformation {
  std::uint32_t frame = 0;  ///< ComplianceFrame::number
  std::array<int, 3> nodes{0, 0, 0};
  std::array<double, 3> first_patient_mm{};  ///< Position of node (0, 0, 0); patient frame
  /// Orthonormal grid axes as columns of a row-major matrix
  std::array<double, 9> axes{1, 0, 0, 0, 1, 0, 0, 0, 1};
  double spacing_mm = 1;
  std::vector<float> moved_mm;  ///< Displacement of each node in the patient frame: x, y, z; i fastest
};

}  // namespace palpate
