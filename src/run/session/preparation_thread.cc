#include "session/preparation_thread.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <exception>
#include <string>
#include <system_error>

namespace palpate {
namespace {

constexpr int kLowestPriority = 19;

}  // namespace

Result<void> PreparationThread::wake(const LiveModel::Lock& /*held*/) try {
  if (ending_) return {};
  if (!thread_.joinable()) thread_ = std::thread([this] { run(); });
  woken_.notify_one();
  return {};
} catch (const std::system_error& error) {
  return Error{ErrorKind::kUnavailable,
               std::string("cannot start the thread for model changes: ") + error.what(), "",
               "close other programs, or raise the process limit (ulimit -u)"};
}

void PreparationThread::end() {
  {
    const LiveModel::Lock lock = model_.lock();
    ending_.store(true);
  }
  woken_.notify_one();
  if (thread_.joinable()) thread_.join();
}

PreparedChoice* PreparationThread::next_pending(const LiveModel::Lock& lock) const {
  const auto pending =
      std::ranges::find_if(choices_, [&](const PreparedChoice* choice) { return choice->is_pending(lock); });
  return pending != choices_.end() ? *pending : nullptr;
}

void PreparationThread::run() {
  // threads started from here inherit the lowest priority
  ::setpriority(PRIO_PROCESS, static_cast<id_t>(::gettid()), kLowestPriority);
  const Progress progress({}, &ending_);
  LiveModel::Lock lock = model_.lock();
  while (true) try {
      PreparedChoice* pending = nullptr;
      woken_.wait(lock, [&] { return ending_ || (pending = next_pending(lock)) != nullptr; });
      if (ending_) return;
      pending->prepare(lock, progress);
    } catch (const std::exception&) {
      if (!lock) lock.lock();
      for (PreparedChoice* choice : choices_) choice->abandon_without_memory(lock);
    }
}

}  // namespace palpate
