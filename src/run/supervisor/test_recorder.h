#pragma once

#include <atomic>
#include <filesystem>
#include <memory>

#include "palpate/base/check.h"
#include "palpate/recording/recorder.h"
#include "palpate/recording/recording.h"
#include "palpate/servo/servo_loop.h"
#include "supervisor/test_device.h"

namespace palpate::testing {

/// Makes the recorder of start_recorder() throw on its thread.
inline std::atomic<bool> recorder_throws{false};

/// Records a loop of one device at 1 kHz.
/// @param file  empty: only counts ticks
inline std::unique_ptr<Recorder> start_recorder(ServoLoop& loop, const std::filesystem::path& file) {
  RecordingHeader header;
  header.clock = "real";
  header.scheduler = loop.scheduling().scheduler;
  header.scene_title = "a ball";
  auto recorder =
      Recorder::start(loop.ring(), file, header, [](const TickRecord&, std::span<const RecordingEvent>) {
        if (recorder_throws) throw_for_a_test();
      });
  PALPATE_CHECK(recorder.ok());
  return *std::move(recorder);
}

}  // namespace palpate::testing
