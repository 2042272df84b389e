#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "palpate/base/result.h"
#include "palpate/device/model_change.h"
#include "palpate/device/session_settings.h"

/// Requests of viewers, and their outcomes.
namespace palpate {

/// Identity of a viewer, as passed to the session with its requests.
struct ViewerIdentity {
  std::uint32_t number = 0;  ///< From 1, in the order of the viewers' hello messages
  bool control = false;      ///< Whether it may change things; every viewer may stop
  std::string learner{};     ///< Pseudonym of a learner with a token; empty: another role
  bool teaches = false;      ///< Whether it leads the lesson; its actions are not attributed to a learner
};

/// Well-formed request; the host decides whether to grant it.
struct SettingsRequest : SettingsChanges {
  ViewerIdentity by;
  std::int64_t id = 0;  ///< Identifier chosen by the viewer, for a late answer
};
struct TissueRequest {
  int tissue = 0;
  ContactPropertyChanges changes;
  ViewerIdentity by;
  std::int64_t id = 0;
};
/// Undoes a burr's last stroke, or redoes the stroke undone last.
struct StrokeRequest {
  StrokeAction action = StrokeAction::kUndo;
  ViewerIdentity by;
  std::int64_t id = 0;
};
/// Request to enable the force again after a stop.
struct RearmRequest {
  std::uint32_t stop = 0;  ///< Number of the stop that the viewer has seen
  ViewerIdentity by;
  std::string code = {};  ///< Code displayed next to a physical device; empty: none given
};

/// Settings of a lesson; missing values stay unchanged.
struct LessonRequest {
  std::optional<std::string> learner{}, task{};  ///< As in ViewedState::Lesson
  std::optional<bool> names{};                   ///< Whether learners are shown what a quiz hides
  /// Pseudonym of the learner whose page gets the pointer; empty: the current owner loses it
  std::optional<std::string> pointer{};
  bool end = false;  ///< Ends the session
};

/// Playback control of a recording.
struct PlayRequest {
  std::optional<double> at_s;   ///< Time of the recording; clamped to its ends
  std::optional<bool> playing;  ///< Playing at the end restarts from the beginning
  std::optional<double> speed;  ///< Ratio to real time, within kPlayingSpeeds; negative: backwards
};
/// Minimum and maximum magnitude of the playback speed.
inline constexpr std::array<double, 2> kPlayingSpeeds{0.01, 32};

/// Outcome of a request that was not refused.
enum class RequestOutcome : std::uint8_t {
  kDone,
  kAwaitingConsent,  ///< The operator at the device is asked for consent; a LateAnswer follows
};
/// Outcome of a request that waited for consent.
struct LateAnswer {
  ViewerIdentity by;
  std::int64_t id = 0;
  Result<void> outcome;
};

/// Target of the pointer's tip; patient frame, mm; finite.
struct PointerTarget {
  std::array<double, 3> tip_patient_mm{};
  /// Unit direction in which the tip presses from `tip_patient_mm`, until the force is `force_N`.
  std::array<double, 3> into{};
  double force_N = 0;     ///< 0: no press, the tip moves to `tip_patient_mm`
  bool set_down = false;  ///< The tip is there at once, without a path to it, and its contact is reset
};

}  // namespace palpate
