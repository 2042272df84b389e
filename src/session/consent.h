#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <list>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "palpate/link/viewer_server.h"
#include "palpate/session/explore.h"

namespace palpate {

/// Requests of viewers that wait until somebody where palpate runs agrees to them.
///
///     viewer ── ask() ──► the one that waits longest is shown ── answer() by a key ──► granted or not
///                └─ another of the same viewer's takes its place        └─► take_answers(): the viewer is
///                told
///
/// An answer is to what was shown: it names its number, and one that has been replaced meanwhile is another.
/// Any thread; `grant` is called on that of answer(), without any lock of this.
class Consent {
 public:
  using Clock = std::chrono::steady_clock;
  /// A question that nobody answers is refused after so long.
  static constexpr std::chrono::seconds kPatience{20};

  /// @param who, id  of the request, for the answer
  /// @param what     "turn the object by 20 degrees": what they want to do
  /// @param grant    does it; its error is the viewer's
  void ask(const ViewerIdentity& who, std::int64_t id, std::string what, std::function<Result<void>()> grant,
           Clock::time_point now = Clock::now());
  /// The one to be answered next.
  std::optional<ConsentQuestion> question(Clock::time_point now = Clock::now());
  /// @param number  of the question that was shown
  void answer(std::uint64_t number, bool agreed, Clock::time_point now = Clock::now());
  /// A viewer is gone: nobody waits for an answer.
  void forget(const ViewerIdentity& who);
  /// What viewers are to be told since the last time.
  std::vector<LateAnswer> take_answers(Clock::time_point now = Clock::now());

 private:
  struct Waiting {
    std::uint64_t number = 0;
    ViewerIdentity who;
    std::int64_t id = 0;
    std::string what;
    std::function<Result<void>()> grant;
    Clock::time_point until;
  };
  void tell(const Waiting& waiting, Result<void> outcome);
  void drop_old(Clock::time_point now);

  std::mutex mutex_;
  std::uint64_t questions_ = 0;
  std::list<Waiting> waiting_;  // in the order in which their viewers asked first
  std::vector<LateAnswer> answers_;
};

}  // namespace palpate
