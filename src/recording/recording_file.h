#pragma once

#include <memory>

#include "palpate/recording/recording.h"
#include "recording/commit_file.h"

namespace palpate::internal {

/// The writer behind RecordingWriter::create, on any sink. When it returns, the sink holds a whole
/// recording without ticks. `file` only names errors.
Result<std::unique_ptr<RecordingWriter>> create_on(std::unique_ptr<ByteSink> sink,
                                                   const RecordingHeader& header,
                                                   const std::filesystem::path& file);

/// The recorder behind Recorder::start, with any writer or none. `file` only names errors.
Result<std::unique_ptr<Recorder>> start_recorder(SpscRing<TickRecord>& ring,
                                                 std::unique_ptr<RecordingWriter> writer,
                                                 const std::filesystem::path& file, Recorder::See see,
                                                 EventLog* told = nullptr);

}  // namespace palpate::internal
