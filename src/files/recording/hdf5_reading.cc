#include "recording/hdf5_reading.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "palpate/device/device.h"
#include "recording/header_fields.h"

namespace palpate::internal {
namespace {

// decompression limit: a recording compressed by other tools may expand to this multiple of its size in total
constexpr std::uint64_t kMaxExpansion = 100;
constexpr std::uint64_t kMaxFileBytes = std::uint64_t{1} << 50;
constexpr hsize_t kMaxChunkBytes = hsize_t{64} << 20;

// groups and data sets in the file itself: external and soft links are not followed
bool is_there(hid_t parent, const std::string& name) {
  H5L_info_t info;
  return H5Lexists(parent, name.c_str(), H5P_DEFAULT) > 0 &&
         H5Lget_info(parent, name.c_str(), &info, H5P_DEFAULT) >= 0 && info.type == H5L_TYPE_HARD;
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

}  // namespace

DecompressionBudget::DecompressionBudget(std::uint64_t file_bytes)
    : remaining_bytes(std::min(file_bytes, kMaxFileBytes) * kMaxExpansion) {}

void require(bool condition, const std::string& what) {
  if (!condition) throw Refusal{"the recording is damaged: " + what, ""};
}

Handle open_group(hid_t parent, const std::string& name) {
  require(is_there(parent, name), "it has no group /" + name);
  Handle group(H5Gopen2(parent, name.c_str(), H5P_DEFAULT), H5Gclose);
  require(group.ok(), "the group /" + name + " cannot be opened");
  return group;
}

bool same_type(const Handle& type, hid_t ours) {
  const H5T_class_t kind = H5Tget_class(ours);
  return H5Tget_class(type.get()) == kind && H5Tget_size(type.get()) == H5Tget_size(ours) &&
         (kind != H5T_INTEGER || H5Tget_sign(type.get()) == H5Tget_sign(ours));
}

Attribute::Attribute(hid_t object, const std::string& name) : name_("the attribute " + name) {
  require(H5Aexists(object, name.c_str()) > 0, name_ + " is missing");
  attribute_ = Handle(H5Aopen(object, name.c_str(), H5P_DEFAULT), H5Aclose);
  type_ = Handle(H5Aget_type(attribute_.get()), H5Tclose);
  const Handle space(H5Aget_space(attribute_.get()), H5Sclose);
  require(H5Sget_simple_extent_npoints(space.get()) == 1, name_ + " is not one value");
}

std::string Attribute::text() const {
  const std::size_t size = text_size(type_);
  require(size >= 1 && size <= kMaxText, name_ + " is not a text of fixed length");
  std::string text(size, '\0');
  require(H5Aread(attribute_.get(), type_.get(), text.data()) >= 0, name_ + " cannot be read");
  return unpadded(std::move(text));
}

void read_attribute(const Attribute& attribute, std::string& value) {
  value = attribute.text();
}
void read_attribute(const Attribute& attribute, bool& value) {
  value = attribute.number<std::uint8_t>(H5T_STD_U8LE) != 0;
}
void read_attribute(const Attribute& attribute, std::uint32_t& value) {
  value = attribute.number<std::uint32_t>(H5T_STD_U32LE);
}
void read_attribute(const Attribute& attribute, std::uint64_t& value) {
  value = attribute.number<std::uint64_t>(H5T_STD_U64LE);
}
void read_attribute(const Attribute& attribute, double& value) {
  value = attribute.number<double>(H5T_IEEE_F64LE);
}
void read_attribute(const Attribute& attribute, int& value) {
  const auto number = attribute.number<std::uint32_t>(H5T_STD_U32LE);
  require(number <= kMaxDevices, "it names " + std::to_string(number) + " devices");
  value = static_cast<int>(number);
}

DataSet::DataSet(hid_t group, const std::string& group_name, const std::string& name)
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

void DataSet::require_shape(int rank, hsize_t width) const {
  require(rank_ == rank && (rank < 2 || dims_[1] == width), name_ + " has another shape");
}

void DataSet::require_rows(hsize_t rows) const {
  require(rows_or_one() == rows, name_ + " has another length");
}

void DataSet::require_type(hid_t type) const {
  require(same_type(type_, type), name_ + " has another type");
}

void DataSet::read_all(hid_t type, void* values) const {
  require(H5Dread(data_set_.get(), type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values) >= 0,
          name_ + " cannot be read");
}

void DataSet::read_rows(hid_t type, hsize_t first, hsize_t count, void* values) const {
  const hsize_t start[2] = {first, 0}, size[2] = {count, dims_[1]};
  const Handle memory(H5Screate_simple(rank_, size, nullptr), H5Sclose);
  require(H5Sselect_hyperslab(space_.get(), H5S_SELECT_SET, start, nullptr, size, nullptr) >= 0 &&
              H5Dread(data_set_.get(), type, memory.get(), space_.get(), H5P_DEFAULT, values) >= 0,
          name_ + " cannot be read");
}

std::vector<std::string> DataSet::texts(std::size_t largest) const {
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

void DataSet::require_stored(DecompressionBudget& budget, const std::optional<RowRange>& range) const {
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

hsize_t DataSet::rows_or_one() const {
  return rank_ == 0 ? 1 : dims_[0];
}

// Checks chunks individually: counting all chunks of a long run takes several times as long as reading a
// range of it
void DataSet::require_chunks(const RowRange& range) const {
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

void DataSet::check_layout() {
  const H5D_layout_t layout = H5Pget_layout(properties_.get());
  require(layout == H5D_CHUNKED || layout == H5D_CONTIGUOUS || layout == H5D_COMPACT,
          name_ + " is stored in another file");
  require(H5Pget_external_count(properties_.get()) == 0, name_ + " is stored in another file");
  if (layout != H5D_CHUNKED) return;
  require(H5Pget_chunk(properties_.get(), 2, chunk_.data()) == rank_, name_ + " has chunks of another shape");
  require(chunk_[0] >= 1 && chunk_[0] <= kMaxChunkBytes && chunk_[1] >= 1 && chunk_[1] <= dims_[1] &&
              chunk_[0] * chunk_[1] <= kMaxChunkBytes / H5Tget_size(type_.get()),
          name_ + " has chunks of another shape");
}

}  // namespace palpate::internal
