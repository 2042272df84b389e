#include "recording/hdf5_reader.h"

#include <algorithm>
#include <cstring>
#include <optional>
#include <span>
#include <string_view>

#include "palpate/device/device.h"
#include "recording/columns.h"
#include "recording/hdf5_reading.h"
#include "recording/hdf5_types.h"
#include "recording/header_fields.h"

namespace palpate::internal {
namespace {

// a column and its data set, which a recording older than the column lacks
struct StoredColumn {
  const Column* column;
  std::optional<DataSet> data_set;

  // an absent column reads as 0
  void read_rows(hsize_t first, hsize_t count, void* values) const {
    if (data_set)
      data_set->read_rows(hdf5_type(column->number), first, count, values);
    else
      std::memset(values, 0, static_cast<std::size_t>(count) * column->row_bytes());
  }
};

void check_format(hid_t file) {
  if (H5Aexists(file, "format") <= 0 || Attribute(file, "format").text() != kFormat)
    throw Refusal{"is an HDF5 file, but not a recording of palpate",
                  "give a file written by palpate simulate or explore"};
  const auto major = Attribute(file, "format_major").number<std::uint32_t>(H5T_STD_U32LE);
  if (major > kFormatMajor)
    throw Refusal{"was written by a newer palpate: format " + std::to_string(major) +
                      ", this one reads format " + std::to_string(kFormatMajor),
                  "use a newer palpate"};
  if (major < kFormatMajor)
    throw Refusal{"was made by an earlier palpate (format " + std::to_string(major) +
                      "; this one reads format " + std::to_string(kFormatMajor) + ")",
                  "record it again"};
}

void read_structures(hid_t file, DecompressionBudget& budget,
                     std::vector<RecordingHeader::Structure>& structures) {
  const Handle group = open_group(file, "structures");
  const auto open = [&](const char* name, int rank, std::size_t width) {
    DataSet data_set(group.get(), "structures", name);
    data_set.require_shape(rank, width);
    return data_set;
  };
  const DataSet label = open("label", 1, 1), colour = open("colour", 2, 3), name = open("name", 1, 1),
                tissue = open("tissue", 1, 1);
  const hsize_t count = label.rows();
  require(count <= kMaxStructures, "it lists too many structures");
  for (const DataSet* data_set : {&label, &colour, &name, &tissue}) {
    data_set->require_rows(count);
    data_set->require_stored(budget);
  }
  label.require_type(H5T_STD_U16LE);
  colour.require_type(H5T_STD_U8LE);

  std::vector<LabelId> labels(count);
  std::vector<Rgb> colours(count);
  label.read_all(H5T_STD_U16LE, labels.data());
  colour.read_all(H5T_STD_U8LE, colours.data());
  const auto names = name.texts(kMaxText), tissues = tissue.texts(kMaxText);
  for (std::size_t i = 0; i < count; ++i) structures.push_back({labels[i], names[i], tissues[i], colours[i]});
}

RecordingHeader read_header(hid_t file, DecompressionBudget& budget) {
  RecordingHeader header;
  const Handle group = open_group(file, "header");
  visit_header(header,
               [&](const char* name, auto& value) { read_attribute(Attribute(group.get(), name), value); });
  require(header.devices >= 1, "it names 0 devices");
  require(header.tissue_cell_factor >= 1 && header.tissue_cell_factor <= kMaxTissueCellFactor,
          "the cell size of its soft tissue is invalid");
  const DataSet script(group.get(), "header", "script");
  script.require_shape(0);
  header.script_text = script.texts(kMaxScript).front();
  read_structures(file, budget, header.structures);
  return header;
}

std::optional<RecordingSummary> read_summary(hid_t file, DecompressionBudget& budget) {
  const Handle group = open_group(file, "summary");
  const auto number = [&](const char* name, hid_t type, void* value) {
    const DataSet data_set(group.get(), "summary", name);
    data_set.require_shape(0);
    data_set.require_type(type);
    data_set.read_all(type, value);
  };
  std::uint8_t complete = 0;
  number("complete", H5T_STD_U8LE, &complete);
  if (complete == 0) return std::nullopt;
  RecordingSummary summary;
  visit_summary(summary,
                [&](const char* name, std::uint64_t& value) { number(name, H5T_STD_U64LE, &value); });
  const DataSet problems(group.get(), "summary", "trouble");
  problems.require_shape(1);
  require(problems.rows() <= kMaxProblems, "it lists too many problems");
  problems.require_stored(budget);
  summary.problems = problems.texts(kMaxText);
  return summary;
}

void open_columns(hid_t file, const std::string& group_name, std::span<const Column> columns,
                  const std::optional<RowRange>& range, DecompressionBudget& budget,
                  std::vector<StoredColumn>& opened) {
  const Handle group = open_group(file, group_name);
  const auto minor = Attribute(file, "format_minor").number<std::uint32_t>(H5T_STD_U32LE);
  for (const Column& column : columns) {
    if (column.since_minor > minor) {
      opened.push_back({&column, {}});
      continue;
    }
    DataSet data_set(group.get(), group_name, column.name);
    data_set.require_type(hdf5_type(column.number));
    data_set.require_shape(column.width == 1 ? 1 : 2, column.width);
    data_set.require_stored(budget, range);
    opened.push_back({&column, std::move(data_set)});
  }
}

std::uint64_t common_rows(const std::vector<StoredColumn>& columns, bool complete) {
  // the first column of every group is as old as the format
  std::uint64_t rows = columns.front().data_set->rows();
  for (const StoredColumn& column : columns) {
    if (!column.data_set) continue;
    // in an incomplete recording some columns may be longer than others
    if (complete) column.data_set->require_rows(rows);
    rows = std::min<std::uint64_t>(rows, column.data_set->rows());
  }
  return rows;
}

// Stream of all events in order, in batches.
class EventQueue {
 public:
  EventQueue(std::vector<StoredColumn> columns, std::uint64_t rows)
      : columns_(std::move(columns)), rows_(rows) {}
  // up to kBlockRows events not after `tick` that were not taken yet
  std::vector<RecordingEvent> take(std::uint64_t tick) {
    std::vector<RecordingEvent> events;
    while (events.size() < kBlockRows) {
      if (next_ == waiting_.size()) refill();
      if (next_ == waiting_.size() || waiting_[next_].tick > tick) break;
      events.push_back(waiting_[next_++]);
    }
    return events;
  }

 private:
  void refill() {
    const std::uint64_t count = std::min(kBlockRows, rows_ - read_);
    if (count == 0) return;
    waiting_.assign(static_cast<std::size_t>(count), {});
    next_ = 0;
    std::vector<std::byte> values;
    for (const StoredColumn& stored : columns_) {
      const std::size_t width = stored.column->row_bytes();
      values.resize(waiting_.size() * width);
      stored.read_rows(read_, count, values.data());
      for (std::size_t row = 0; row < waiting_.size(); ++row)
        std::memcpy(reinterpret_cast<std::byte*>(&waiting_[row]) + stored.column->offset,
                    values.data() + row * width, width);
    }
    read_ += count;
  }

  std::vector<StoredColumn> columns_;
  std::uint64_t rows_ = 0, read_ = 0;
  std::vector<RecordingEvent> waiting_;
  std::size_t next_ = 0;
};

EventQueue open_events(hid_t file, DecompressionBudget& budget, bool complete) {
  std::vector<StoredColumn> columns;
  open_columns(file, "events", event_columns(), {}, budget, columns);
  const std::uint64_t rows = common_rows(columns, complete);
  return {std::move(columns), rows};
}

template <class T>
std::vector<T> read_column(const std::vector<StoredColumn>& columns, std::string_view name,
                           std::uint64_t first, std::uint64_t count) {
  const auto found =
      std::ranges::find_if(columns, [&](const StoredColumn& stored) { return stored.column->name == name; });
  std::vector<T> values(static_cast<std::size_t>(count));
  found->read_rows(first, count, values.data());
  return values;
}

// computes the part of the head that depends on ticks, from the few columns needed
void read_tick_properties(const std::vector<StoredColumn>& columns, const RowRange& rows,
                          RecordingHead& head) {
  TickProperties properties;
  const std::uint64_t end = rows.first + rows.count;
  for (std::uint64_t first = rows.first; first < end; first += kBlockRows) {
    const std::uint64_t count = std::min(kBlockRows, end - first);
    const auto tick = read_column<std::uint64_t>(columns, "tick", first, count);
    const auto time_s = read_column<double>(columns, "time_s", first, count);
    const auto method = read_column<std::uint8_t>(columns, "method", first, count);
    for (std::size_t i = 0; i < count; ++i) properties.observe(tick[i], time_s[i], method[i]);
  }
  properties.write_to(head);
}

bool send_parts(const std::vector<StoredColumn>& columns, const RowRange& rows, EventQueue& events,
                ByteTarget& target) {
  std::vector<std::byte> buffer;
  const std::uint64_t end = rows.first + rows.count;
  for (std::uint64_t first = rows.first; first < end; first += kBlockRows) {
    const std::uint64_t count = std::min(kBlockRows, end - first);
    const std::uint64_t last_tick = read_column<std::uint64_t>(columns, "tick", first + count - 1, 1).front();
    auto of_these = events.take(last_tick);
    for (; of_these.size() == kBlockRows; of_these = events.take(last_tick))
      if (!send_events(target, of_these, 0)) return false;
    if (!send_events(target, of_these, static_cast<std::uint32_t>(count))) return false;
    for (const StoredColumn& stored : columns) {
      buffer.assign(static_cast<std::size_t>(count) * stored.column->row_bytes(), std::byte{0});
      stored.read_rows(first, count, buffer.data());
      if (!target.write(buffer)) return false;
    }
  }
  return true;
}

Handle open_file(const std::filesystem::path& file) {
  // no filter plug-ins, and no waiting for the file lock of a writer
  H5PLset_loading_state(0);
  const Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  H5Pset_file_locking(access.get(), false, true);
  // chunk cache for the one chunk of each data set that two blocks share, instead of HDF5's megabyte per
  // column
  H5Pset_cache(access.get(), 0, 521, std::size_t{128} << 10, 0.75);
  return Handle(H5Fopen(file.c_str(), H5F_ACC_RDONLY, access.get()), H5Fclose);
}

}  // namespace

bool send_recording(const std::filesystem::path& file, ByteTarget& target, std::optional<RowRange> range) {
  bool head_sent = false;
  try {
    const Handle opened = open_file(file);
    require(opened.ok(), "HDF5 cannot open it");
    check_format(opened.get());
    hsize_t file_bytes = 0;
    require(H5Fget_filesize(opened.get(), &file_bytes) >= 0, "HDF5 cannot open it");
    DecompressionBudget budget(file_bytes);

    RecordingHead head;
    head.header = read_header(opened.get(), budget);
    head.summary = read_summary(opened.get(), budget);
    const bool complete = head.summary.has_value();
    // determine the ticks' ends first: the events that they acknowledge precede them in the file, also while
    // it is being written
    std::vector<StoredColumn> columns;
    open_columns(opened.get(), "ticks", tick_columns(), range, budget, columns);
    for (int d = 0; d < head.header.devices; ++d)
      open_columns(opened.get(), "device" + std::to_string(d), device_columns(), range, budget, columns);
    const std::uint64_t rows = common_rows(columns, complete);
    if (range) {
      range->first = std::min(range->first, rows);
      range->count = std::min(range->count, rows - range->first);
      head.summary.reset();
    }
    const RowRange requested = range.value_or(RowRange{0, rows});
    EventQueue events = range ? EventQueue({}, 0) : open_events(opened.get(), budget, complete);
    read_tick_properties(columns, requested, head);

    head_sent = true;
    return send_head(target, head) && send_parts(columns, requested, events, target);
  } catch (const Refusal& refusal) {
    return !head_sent && send_refusal(target, {ErrorKind::kBadInput, refusal.what, "", refusal.remedy});
  }
}

}  // namespace palpate::internal
