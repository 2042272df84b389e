#include "palpate/recording/recording.h"
#include "palpate/recording/recording_source.h"

#include <cstring>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "c/guard.h"
#include "c/record.h"

struct plp_recording {
  static constexpr palpate::c::Tag kTag = palpate::c::Tag::kRecording;
  explicit plp_recording(palpate::RecordingSource opened) : source(std::move(opened)) {}
  ~plp_recording() { tag = palpate::c::Tag::kNone; }

  palpate::c::Tag tag = kTag;
  palpate::RecordingSource source;
};

namespace palpate::c {
namespace {

// ticks read at a time
constexpr std::size_t kBlock = 4096;

plp_recording_info info_of(const RecordingHead& head) {
  plp_recording_info info{};
  info.devices = static_cast<std::uint32_t>(head.header.devices);
  info.ticks = head.ticks;
  info.run_hash = head.summary ? head.summary->run_hash : 0;
  info.model_hash = head.header.model_hash;
  info.rate_hz = head.header.rate_hz;
  info.data_set = head.header.data_set.c_str();
  info.title = head.header.scene_title.c_str();
  info.script = head.header.script_text.c_str();
  info.complete = head.summary.has_value();
  info.simulated = head.header.simulated;
  return info;
}

// Calls `take(index, record)` for ticks first ... first + count - 1 of a device.
template <class Take>
plp_status for_each_record(const plp_recording* recording, std::size_t device, std::uint64_t first,
                           std::size_t count, const Take& take) {
  const RecordingHead& head = recording->source.head();
  if (device >= static_cast<std::size_t>(head.header.devices))
    return fail(PLP_BAD_INPUT, "device: there is no device " + std::to_string(device));
  if (first > head.ticks || count > head.ticks - first)
    return fail(PLP_BAD_INPUT, "count: the recording has " + std::to_string(head.ticks) + " ticks");
  for (std::size_t done = 0; done < count;) {
    const auto ticks = recording->source.read_at(first + done, std::min(kBlock, count - done));
    if (!ticks) return fail(ticks.error());
    if (ticks->empty()) return fail(PLP_BAD_INPUT, "the recording ends early");
    for (const TickRecord& tick : *ticks) take(done++, record_of(tick, device));
  }
  return PLP_OK;
}

// member of plp_record by its name; size 0: there is none
plp_field field_of(const char* name) {
  plp_field field{};
  field.size = sizeof field;
  for (std::size_t index = 0; plp_struct_field("plp_record", index, &field) == PLP_OK; ++index)
    if (std::strcmp(field.name, name) == 0) return field;
  return {};
}

double number_at(const unsigned char* from, std::int32_t type) {
  const auto as = [&](auto value) {
    std::memcpy(&value, from, sizeof value);
    return static_cast<double>(value);
  };
  switch (type) {
    case PLP_INT32:
      return as(std::int32_t{});
    case PLP_UINT32:
      return as(std::uint32_t{});
    case PLP_UINT64:
      return as(std::uint64_t{});
    default:
      return as(double{});
  }
}

}  // namespace
}  // namespace palpate::c

using palpate::c::fail;
using palpate::c::guarded;
using palpate::c::is_handle;

plp_status plp_recording_open(const char* file, plp_recording** recording) {
  return guarded([&] {
    if (recording == nullptr) return fail(PLP_BAD_INPUT, "recording: the place for the result is null");
    *recording = nullptr;
    if (file == nullptr) return fail(PLP_BAD_INPUT, "file: null");
    auto source = palpate::RecordingSource::open(file);
    if (!source) return fail(source.error());
    *recording = new plp_recording(*std::move(source));
    return PLP_OK;
  });
}

plp_status plp_recording_info_get(const plp_recording* recording, plp_recording_info* info) {
  return guarded([&] {
    if (!is_handle(recording)) return PLP_BAD_INPUT;
    return palpate::c::write(palpate::c::info_of(recording->source.head()), info) ? PLP_OK : PLP_BAD_INPUT;
  });
}

plp_status plp_recording_records(const plp_recording* recording, size_t device, uint64_t first, size_t count,
                                 plp_record* records) {
  return guarded([&] {
    const palpate::c::Elements<plp_record> out(records);
    if (!is_handle(recording) || !out.ok()) return PLP_BAD_INPUT;
    if (count > 0 && out.empty()) return fail(PLP_BAD_INPUT, "records: null");
    return palpate::c::for_each_record(recording, device, first, count,
                                       [&](std::size_t n, const plp_record& record) { out.put(n, record); });
  });
}

plp_status plp_recording_column(const plp_recording* recording, size_t device, const char* name,
                                uint64_t first, size_t count, double* column) {
  return guarded([&] {
    if (!is_handle(recording)) return PLP_BAD_INPUT;
    if (name == nullptr || (count > 0 && column == nullptr))
      return fail(PLP_BAD_INPUT, "name or column: null");
    const plp_field field = palpate::c::field_of(name);
    if (field.size == 0) return fail(PLP_BAD_INPUT, "name: a plp_record has no such member");
    const std::size_t bytes = field.type == PLP_FLOAT64 || field.type == PLP_UINT64 ? 8 : 4;
    return palpate::c::for_each_record(
        recording, device, first, count, [&](std::size_t n, const plp_record& record) {
          const auto* const from = reinterpret_cast<const unsigned char*>(&record) + field.offset;
          for (std::size_t c = 0; c < field.count; ++c)
            column[n * field.count + c] = palpate::c::number_at(from + c * bytes, field.type);
        });
  });
}

void plp_recording_destroy(plp_recording* recording) {
  if (recording != nullptr && is_handle(recording)) delete recording;
}
