#pragma once

#include <condition_variable>
#include <mutex>
#include <thread>

#include "palpate/servo/servo_loop.h"
#include "session/tissue_frames.h"

namespace palpate {

/// Thread that solves deforming tissue while it exists, at a lower priority than the ticks and away from
/// their CPU.
class TissueThread {
 public:
  /// @param loop, frames  outlive this object
  TissueThread(const ServoLoop& loop, TissueFrames& frames);
  ~TissueThread();
  TissueThread(const TissueThread&) = delete;
  TissueThread& operator=(const TissueThread&) = delete;

 private:
  void run();

  const ServoLoop& loop_;
  TissueFrames& frames_;
  std::mutex mutex_;  // guards ending_
  bool ending_ = false;
  std::condition_variable ends_;
  std::thread thread_;
};

}  // namespace palpate
