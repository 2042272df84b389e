#include "session/consent.h"

#include <algorithm>
#include <utility>

namespace palpate {
namespace {

Error not_agreed(std::string what, std::string remedy) {
  return {ErrorKind::kUsage, std::move(what), "", std::move(remedy)};
}

}  // namespace

void Consent::finish(const Waiting& waiting, Result<void> outcome) {
  answers_.push_back({waiting.who, waiting.id, std::move(outcome)});
}

void Consent::drop_old(Clock::time_point now) {
  std::erase_if(waiting_, [&](const Waiting& waiting) {
    const bool old = now >= waiting.until;
    if (old)
      finish(waiting, not_agreed("the request was not accepted at the terminal of palpate",
                                 "ask the operator there, then try again"));
    return old;
  });
}

void Consent::ask(const ViewerIdentity& who, std::int64_t id, std::string what,
                  std::function<Result<void>()> grant, Clock::time_point now) {
  const std::lock_guard lock(mutex_);
  drop_old(now);
  auto own = std::find_if(waiting_.begin(), waiting_.end(),
                          [&](const Waiting& waiting) { return waiting.who.number == who.number; });
  if (own == waiting_.end())
    own = waiting_.emplace(waiting_.end());
  else
    finish(*own, not_agreed("the request was replaced by another one before it was accepted", ""));
  *own = {++questions_, who, id, std::move(what), std::move(grant), now + kTimeout};
}

std::optional<ConsentQuestion> Consent::question(Clock::time_point now) {
  const std::lock_guard lock(mutex_);
  drop_old(now);
  if (waiting_.empty()) return std::nullopt;
  const Waiting& first = waiting_.front();
  return ConsentQuestion{first.number,
                         "viewer " + std::to_string(first.who.number) + " wants to " + first.what};
}

void Consent::answer(std::uint64_t number, bool agreed, Clock::time_point now) {
  std::list<Waiting> answered;
  {
    const std::lock_guard lock(mutex_);
    drop_old(now);
    const auto it = std::find_if(waiting_.begin(), waiting_.end(),
                                 [&](const Waiting& waiting) { return waiting.number == number; });
    if (it == waiting_.end()) return;
    answered.splice(answered.end(), waiting_, it);
  }
  Result<void> outcome =
      agreed ? answered.front().grant()
             : Result<void>(not_agreed("the request was declined at the terminal of palpate", ""));
  const std::lock_guard lock(mutex_);
  finish(answered.front(), std::move(outcome));
}

void Consent::forget(const ViewerIdentity& who) {
  const std::lock_guard lock(mutex_);
  std::erase_if(waiting_, [&](const Waiting& waiting) { return waiting.who.number == who.number; });
}

std::vector<LateAnswer> Consent::read_answers(Clock::time_point now) {
  const std::lock_guard lock(mutex_);
  drop_old(now);
  return std::exchange(answers_, {});
}

}  // namespace palpate
