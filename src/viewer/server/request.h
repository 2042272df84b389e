#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>

#include "palpate/server/viewer_host.h"

/// Parsing of viewers' messages (docs/reference/viewer-requests.md).
namespace palpate::server {

/// Maximum length of a viewer's message.
inline constexpr std::size_t kMaxMessage_bytes = 4096;
/// Maximum pose rate of a viewer; the minimum is 1/s.
inline constexpr double kMaxPoses_hz = 120;

/// First message of a viewer: protocol version, authentication and subscriptions.
struct Hello {
  int protocol = 0;
  std::string token;  ///< Empty: none
  double poses_hz = 60;
  bool wants_deformation = false;  ///< Subscribes to deformation
  bool wants_task = false;         ///< Subscribes to the progress of tasks
  bool wants_plan = false;         ///< Subscribes to the plan
  bool wants_distances = false;    ///< Subscribes to distances and no-go regions
  bool wants_ticks = false;        ///< Subscribes to bundles of all ticks
  bool wants_navigation = false;   ///< Subscribes to the error estimate of a tracked tip
};
/// Emergency stop.
struct StopRequest {};
/// Takes or releases control of the pointer.
struct PointerRequest {
  bool take = false;
};
/// Moves the pointer's tip; empty: releases it.
struct TipMessage {
  std::optional<PointerTarget> target;
};

/// Request with an id; an Error if it can only be refused.
struct Request {
  std::int64_t id = 0;
  std::variant<SettingsRequest, TissueRequest, StrokeRequest, StopRequest, RearmRequest, PointerRequest,
               PlayRequest, TaskRequest, PlanRequest, LessonRequest, Error>
      body;
};

using ViewerMessage = std::variant<Hello, TipMessage, Request>;

/// Empty if the text is not a message at all, so that no answer is possible. A message with the type of a
/// stop is a stop whatever else is wrong with it; its id is then 0.
std::optional<ViewerMessage> parse_viewer_message(std::string_view text);

bool is_stop(const std::optional<ViewerMessage>& message);

}  // namespace palpate::server
