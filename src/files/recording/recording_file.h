#pragma once

#include <memory>

#include "palpate/recording/event_log.h"
#include "palpate/recording/recorder.h"
#include "palpate/recording/recording.h"
#include "recording/commit_file.h"

namespace palpate::internal {

/// Implements RecordingWriter::create on any sink. On return the sink contains a valid recording without
/// ticks. `file` is used in error messages only.
Result<std::unique_ptr<RecordingWriter>> create_on(std::unique_ptr<ByteSink> sink,
                                                   const RecordingHeader& header,
                                                   const std::filesystem::path& file);

/// Implements Recorder::start with any writer or none. `file` is used in error messages only.
Result<std::unique_ptr<Recorder>> start_recorder(SpscRing<TickRecord>& ring,
                                                 std::unique_ptr<RecordingWriter> writer,
                                                 const std::filesystem::path& file, Recorder::OnTick on_tick,
                                                 EventLog* log = nullptr);

}  // namespace palpate::internal
