#include "session/tissue_thread.h"

#include <sys/resource.h>
#include <unistd.h>

#include "palpate/servo/realtime.h"

namespace palpate {
namespace {

// nice value: below the ticking threads, above carving and field generation
constexpr int kPriority = 5;

}  // namespace

TissueThread::TissueThread(const ServoLoop& loop, TissueFrames& frames)
    : loop_(loop), frames_(frames), thread_([this] { run(); }) {}

TissueThread::~TissueThread() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  ends_.notify_one();
  thread_.join();
}

void TissueThread::run() {
  setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), kPriority);
  CpuExclusion cpus;
  for (bool ending = false; !ending;) {
    // avoid the servo's CPU: a tick that has to preempt a solution is later than one that finds the CPU idle
    cpus.exclude(loop_.cpu());
    frames_.run_step(TissueFrames::Clock::now());
    std::unique_lock lock(mutex_);
    ending = ends_.wait_until(lock, frames_.due(), [this] { return ending_; });
  }
}

}  // namespace palpate
