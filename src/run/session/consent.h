#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <list>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "palpate/server/viewer_host.h"
#include "palpate/session/explore.h"

namespace palpate {

/// Requests of viewers that wait for the consent of an operator where palpate runs.
///
///    viewer ── ask() ──► the oldest question is displayed ── answer() by a key ──► granted or refused
///                └─ replaces an earlier question of the viewer       └─► read_answers(): to the viewer
///
/// An answer names the number of the question that was displayed; a question that replaced it has another
/// number. Thread-safe; `grant` is called on the thread of answer(), without holding a lock of this class.
class Consent {
 public:
  using Clock = std::chrono::steady_clock;
  /// Time after which an unanswered question is refused.
  static constexpr std::chrono::seconds kTimeout{20};

  /// @param who, id  viewer and request id, for the answer
  /// @param what     description of the change: "turn the object by 20 degrees"
  /// @param grant    carries the request out; its error is reported to the viewer
  void ask(const ViewerIdentity& who, std::int64_t id, std::string what, std::function<Result<void>()> grant,
           Clock::time_point now = Clock::now());
  /// Question to be answered next.
  std::optional<ConsentQuestion> question(Clock::time_point now = Clock::now());
  /// @param number  number of the question that was displayed
  void answer(std::uint64_t number, bool agreed, Clock::time_point now = Clock::now());
  /// Discards the questions and answers of a viewer that disconnected.
  void forget(const ViewerIdentity& who);
  /// Answers for viewers since the last call.
  std::vector<LateAnswer> read_answers(Clock::time_point now = Clock::now());

 private:
  struct Waiting {
    std::uint64_t number = 0;
    ViewerIdentity who;
    std::int64_t id = 0;
    std::string what;
    std::function<Result<void>()> grant;
    Clock::time_point until;
  };
  void finish(const Waiting& waiting, Result<void> outcome);
  void drop_old(Clock::time_point now);

  std::mutex mutex_;
  std::uint64_t questions_ = 0;
  std::list<Waiting> waiting_;  // in the order of each viewer's first request
  std::vector<LateAnswer> answers_;
};

}  // namespace palpate
