#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>

#include "palpate/link/viewer_server.h"

/// What viewers say, from text to types (docs/reference/viewer-requests.md).
namespace palpate::link {

/// No message of a viewer's is longer.
inline constexpr std::size_t kMostMessage_bytes = 4096;
/// A viewer gets no more poses a second, and no fewer than one.
inline constexpr double kMostPoses_hz = 120;

struct Hello {
  int protocol = 0;
  std::string token;  ///< empty: none
  double poses_hz = 60;
  bool yielded = false;     ///< it wants to be told how tissue has yielded
  bool task = false;        ///< it wants to be told how far a run of a task is
  bool plan = false;        ///< it wants to be told of the plan that is rehearsed
  bool near = false;        ///< it wants to be told what is near the tools and what keeps them away
  bool navigation = false;  ///< it wants to be told how wrong a tracked tip's place may be
};
struct StopRequest {};
struct PointerRequest {
  bool take = false;
};
struct TipMessage {
  std::array<double, 3> tip_patient_mm{};
};

/// What is asked for under an id; an Error where the answer can only be that it is refused.
struct Request {
  std::int64_t id = 0;
  std::variant<SettingsRequest, TissueRequest, StrokeRequest, StopRequest, RearmRequest, PointerRequest,
               PlayRequest, TaskRequest, PlanRequest, LessonRequest, Error>
      what;
};

using ViewerMessage = std::variant<Hello, TipMessage, Request>;

/// Nothing where the text is no message at all, so that nothing could be answered. One that says that it is a
/// stop is a stop, whatever else is wrong with it; its id is then 0.
std::optional<ViewerMessage> parse_viewer_message(std::string_view text);

bool is_stop(const std::optional<ViewerMessage>& message);

}  // namespace palpate::link
