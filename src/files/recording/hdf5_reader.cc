#include "recording/hdf5_reader.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <optional>
#include <string_view>
#include <type_traits>

#include "palpate/device/device.h"
#include "recording/columns.h"
#include "recording/hdf5_types.h"
#include "recording/header_fields.h"

namespace palpate::internal {
namespace {

// decompression limit: a recording compressed by other tools may expand to this multiple of its size in total
constexpr std::uint64_t kMaxExpansion = 100;
constexpr std::uint64_t kMaxFileBytes = std::uint64_t{1} << 50;
constexpr hsize_t kMaxChunkBytes = hsize_t{64} << 20;

// thrown and caught within this file
struct Refusal {
  std::string what, remedy;
};

// remaining decompression budget of a file
struct DecompressionBudget {
  explicit DecompressionBudget(std::uint64_t file_bytes)
      : remaining_bytes(std::min(file_bytes, kMaxFileBytes) * kMaxExpansion) {}
  std::uint64_t remaining_bytes;
};

void require(bool condition, const std::string& what) {
  if (!condition) throw Refusal{"the recording is damaged: " + what, ""};
}

// groups and data sets in the file itself: external and soft links are not followed
bool is_there(hid_t parent, const std::string& name) {
  H5L_info_t info;
  return H5Lexists(parent, name.c_str(), H5P_DEFAULT) > 0 &&
         H5Lget_info(parent, name.c_str(), &info, H5P_DEFAULT) >= 0 && info.type == H5L_TYPE_HARD;
}

Handle open_group(hid_t parent, const std::string& name) {
  require(is_there(parent, name), "it has no group /" + name);
  Handle group(H5Gopen2(parent, name.c_str(), H5P_DEFAULT), H5Gclose);
  require(group.ok(), "the group /" + name + " cannot be opened");
  return group;
}

// equal class, size and sign; byte order may differ
bool same_type(const Handle& type, hid_t ours) {
  const H5T_class_t kind = H5Tget_class(ours);
  return H5Tget_class(type.get()) == kind && H5Tget_size(type.get()) == H5Tget_size(ours) &&
         (kind != H5T_INTEGER || H5Tget_sign(type.get()) == H5Tget_sign(ours));
}

// size of a fixed-length string type in bytes; 0 for any other type
std::size_t text_size(const Handle& type) {
  const bool fixed = H5Tget_class(type.get()) == H5T_STRING && H5Tis_variable_str(type.get()) == 0;
  return fixed ? H5Tget_size(type.get()) : 0;
}

// strings are zero-padded
std::string unpadded(std::string text) {
  text.resize(std::min(text.size(), text.find('\0')));
  return text;
}

class Attribute {
 public:
  Attribute(hid_t object, const std::string& name) : name_("the attribute " + name) {
    require(H5Aexists(object, name.c_str()) > 0, name_ + " is missing");
    attribute_ = Handle(H5Aopen(object, name.c_str(), H5P_DEFAULT), H5Aclose);
    type_ = Handle(H5Aget_type(attribute_.get()), H5Tclose);
    const Handle space(H5Aget_space(attribute_.get()), H5Sclose);
    require(H5Sget_simple_extent_npoints(space.get()) == 1, name_ + " is not one value");
  }

  std::string text() const {
    const std::size_t size = text_size(type_);
    require(size >= 1 && size <= kMaxText, name_ + " is not a text of fixed length");
    std::string text(size, '\0');
    require(H5Aread(attribute_.get(), type_.get(), text.data()) >= 0, name_ + " cannot be read");
    return unpadded(std::move(text));
  }

  template <class Plain>
  Plain number(hid_t type) const {
    Plain value{};
    require(same_type(type_, type), name_ + " has another type");
    require(H5Aread(attribute_.get(), type, &value) >= 0, name_ + " cannot be read");
    return value;
  }

 private:
  std::string name_;
  Handle attribute_, type_;
};

void read(const Attribute& attribute, std::string& value) {
  value = attribute.text();
}
void read(const Attribute& attribute, bool& value) {
  value = attribute.number<std::uint8_t>(H5T_STD_U8LE) != 0;
}
void read(const Attribute& attribute, std::uint32_t& value) {
  value = attribute.number<std::uint32_t>(H5T_STD_U32LE);
}
void read(const Attribute& attribute, std::uint64_t& value) {
  value = attribute.number<std::uint64_t>(H5T_STD_U64LE);
}
void read(const Attribute& attribute, double& value) {
  value = attribute.number<double>(H5T_IEEE_F64LE);
}
void read(const Attribute& attribute, int& value) {
  const auto number = attribute.number<std::uint32_t>(H5T_STD_U32LE);
  require(number <= kMaxDevices, "it names " + std::to_string(number) + " devices");
  value = static_cast<int>(number);
}

class DataSet {
 public:
  DataSet(hid_t group, const std::string& group_name, const std::string& name)
      : name_("the data set /" + group_name + "/" + name) {
    require(is_there(group, name), name_ + " is missing");
    data_set_ = Handle(H5Dopen2(group, name.c_str(), H5P_DEFAULT), H5Dclose);
    require(data_set_.ok(), name_ + " cannot be opened");
    type_ = Handle(H5Dget_type(data_set_.get()), H5Tclose);
    space_ = Handle(H5Dget_space(data_set_.get()), H5Sclose);
    properties_ = Handle(H5Dget_create_plist(data_set_.get()), H5Pclose);
    rank_ = H5Sget_simple_extent_ndims(space_.get());
    require(rank_ >= 0 && rank_ <= 2 && H5Sget_simple_extent_dims(space_.get(), dims_.data(), nullptr) >= 0,
            name_ + " has another shape");
    require(H5Tget_size(type_.get()) >= 1 && dims_[1] >= 1 && dims_[1] <= kMaxChunkBytes,
            name_ + " has another shape");
    check_layout();
  }

  hsize_t rows() const { return dims_[0]; }
  // [] for rank 0, [N] for rank 1, [N, width] for rank 2
  void require_shape(int rank, hsize_t width = 1) const {
    require(rank_ == rank && (rank < 2 || dims_[1] == width), name_ + " has another shape");
  }
  void require_rows(hsize_t rows) const { require(rows_or_one() == rows, name_ + " has another length"); }
  void require_type(hid_t type) const { require(same_type(type_, type), name_ + " has another type"); }

  void read_all(hid_t type, void* values) const {
    require(H5Dread(data_set_.get(), type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values) >= 0,
            name_ + " cannot be read");
  }
  void read_rows(hid_t type, hsize_t first, hsize_t count, void* values) const {
    const hsize_t start[2] = {first, 0}, size[2] = {count, dims_[1]};
    const Handle memory(H5Screate_simple(rank_, size, nullptr), H5Sclose);
    require(H5Sselect_hyperslab(space_.get(), H5S_SELECT_SET, start, nullptr, size, nullptr) >= 0 &&
                H5Dread(data_set_.get(), type, memory.get(), space_.get(), H5P_DEFAULT, values) >= 0,
            name_ + " cannot be read");
  }

  // fixed-length strings: one for rank 0, one per row for rank 1
  std::vector<std::string> texts(std::size_t largest) const {
    const std::size_t size = text_size(type_);
    require(size >= 1 && size <= largest, name_ + " is not a text of fixed length");
    std::string bytes;
    std::vector<std::string> texts;
    if (rank_ == 0) {
      bytes.resize(size);
      read_all(type_.get(), bytes.data());
      return {unpadded(std::move(bytes))};
    }
    // in batches: most of the bytes are padding
    constexpr hsize_t kAtOnce = 1024;
    std::size_t retained = 0;
    for (hsize_t first = 0; first < rows(); first += kAtOnce) {
      const hsize_t count = std::min(kAtOnce, rows() - first);
      bytes.assign(size * static_cast<std::size_t>(count), '\0');
      read_rows(type_.get(), first, count, bytes.data());
      for (std::size_t i = 0; i < count; ++i) {
        texts.push_back(unpadded(bytes.substr(i * size, size)));
        retained += texts.back().size();
      }
      require(retained <= kMaxNames, name_ + " is too long");
    }
    return texts;
  }

  // requires that every row, or every row of a range, is stored: HDF5 would fill gaps with zeros
  void require_stored(DecompressionBudget& budget, const std::optional<RowRange>& range = {}) const {
    const hsize_t rows = rows_or_one(), row_bytes = H5Tget_size(type_.get()) * dims_[1];
    require(rows <= budget.remaining_bytes / row_bytes, name_ + " is longer than the file can hold");
    budget.remaining_bytes -= rows * row_bytes;
    const H5D_layout_t layout = H5Pget_layout(properties_.get());
    if (rows == 0 || layout == H5D_COMPACT) return;
    if (range && layout == H5D_CHUNKED) return require_chunks(*range);
    hsize_t stored = H5Dget_storage_size(data_set_.get()) / row_bytes;
    if (layout == H5D_CHUNKED) {
      hsize_t chunks = 0;
      require(H5Dget_num_chunks(data_set_.get(), space_.get(), &chunks) >= 0, name_ + " cannot be read");
      const hsize_t chunks_side_by_side = (dims_[1] + chunk_[1] - 1) / chunk_[1];
      stored = std::min(chunks / chunks_side_by_side, rows) * chunk_[0];
    }
    require(stored >= rows, name_ + " has gaps");
  }

 private:
  hsize_t rows_or_one() const { return rank_ == 0 ? 1 : dims_[0]; }

  // individually: counting all chunks of a long run takes several times as long as reading a range of it
  void require_chunks(const RowRange& range) const {
    const hsize_t first = std::min<hsize_t>(range.first, dims_[0]),
                  end = first + std::min<hsize_t>(range.count, dims_[0] - first);
    for (hsize_t row = first / chunk_[0] * chunk_[0]; row < end; row += chunk_[0])
      for (hsize_t column = 0; column < dims_[1]; column += chunk_[1]) {
        const hsize_t offset[2] = {row, column};
        hsize_t bytes = 0;
        // HDF5 fails for a chunk that was never stored
        require(H5Dget_chunk_storage_size(data_set_.get(), offset, &bytes) >= 0 && bytes > 0,
                name_ + " has gaps");
      }
  }

  void check_layout() {
    const H5D_layout_t layout = H5Pget_layout(properties_.get());
    require(layout == H5D_CHUNKED || layout == H5D_CONTIGUOUS || layout == H5D_COMPACT,
            name_ + " is stored in another file");
    require(H5Pget_external_count(properties_.get()) == 0, name_ + " is stored in another file");
    if (layout != H5D_CHUNKED) return;
    require(H5Pget_chunk(properties_.get(), 2, chunk_.data()) == rank_,
            name_ + " has chunks of another shape");
    require(chunk_[0] >= 1 && chunk_[0] <= kMaxChunkBytes && chunk_[1] >= 1 && chunk_[1] <= dims_[1] &&
                chunk_[0] * chunk_[1] <= kMaxChunkBytes / H5Tget_size(type_.get()),
            name_ + " has chunks of another shape");
  }

  std::string name_;
  Handle data_set_, type_, space_, properties_;
  int rank_ = 0;
  std::array<hsize_t, 2> dims_{0, 1}, chunk_{1, 1};
};

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
  visit_header(header, [&](const char* name, auto& value) { read(Attribute(group.get(), name), value); });
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
