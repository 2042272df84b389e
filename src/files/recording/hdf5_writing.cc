#include "recording/hdf5_writing.h"

#include <algorithm>

#include "recording/hdf5_types.h"

namespace palpate::internal {
namespace {

Handle space_of(std::initializer_list<hsize_t> dims) {
  if (dims.size() == 0) return Handle(H5Screate(H5S_SCALAR), H5Sclose);
  return Handle(H5Screate_simple(static_cast<int>(dims.size()), dims.begin(), nullptr), H5Sclose);
}

}  // namespace

Handle fixed_text_type(std::size_t size, H5T_cset_t characters) {
  Handle type(H5Tcopy(H5T_C_S1), H5Tclose);
  H5Tset_size(type.get(), std::max<std::size_t>(size, 1));
  H5Tset_strpad(type.get(), H5T_STR_NULLPAD);
  H5Tset_cset(type.get(), characters);
  return type;
}

Handle ObjectWriter::group(const char* name) {
  // stored in the object header; by default HDF5 would move more than eight attributes to a heap
  Handle properties(H5Pcreate(H5P_GROUP_CREATE), H5Pclose);
  check(H5Pset_attr_phase_change(properties.get(), 64, 0));
  check(H5Pset_obj_track_times(properties.get(), false));
  Handle created(H5Gcreate2(file_, name, H5P_DEFAULT, properties.get(), H5P_DEFAULT), H5Gclose);
  check(created.ok() ? 0 : -1);
  return created;
}

void ObjectWriter::raw_attribute(hid_t object, const char* name, hid_t type, const void* value) {
  const Handle space = space_of({});
  const Handle created(H5Acreate2(object, name, type, space.get(), H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
  check(created.ok() ? H5Awrite(created.get(), type, value) : -1);
}

Handle ObjectWriter::data_set(hid_t group, const char* name, hid_t type, std::initializer_list<hsize_t> dims,
                              const void* values) {
  const Handle space = space_of(dims);
  Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  check(H5Pset_obj_track_times(properties.get(), false));
  check(H5Pset_alloc_time(properties.get(), H5D_ALLOC_TIME_EARLY));
  Handle created(H5Dcreate2(group, name, type, space.get(), H5P_DEFAULT, properties.get(), H5P_DEFAULT),
                 H5Dclose);
  check(created.ok() ? H5Dwrite(created.get(), type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values) : -1);
  return created;
}

Handle ObjectWriter::extensible_data_set(hid_t group, const char* name, hid_t type, hsize_t width,
                                         hsize_t chunk_rows) {
  const int rank = width == 1 ? 1 : 2;
  const hsize_t none[2] = {0, width}, chunk[2] = {chunk_rows, width};
  const hsize_t most[2] = {H5S_UNLIMITED, width};
  const Handle space(H5Screate_simple(rank, none, most), H5Sclose);
  Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  check(H5Pset_obj_track_times(properties.get(), false));
  check(H5Pset_chunk(properties.get(), rank, chunk));
  check(H5Pset_shuffle(properties.get()));
  check(H5Pset_deflate(properties.get(), 1));
  // each chunk is written once, immediately: no cache
  Handle access(H5Pcreate(H5P_DATASET_ACCESS), H5Pclose);
  check(H5Pset_chunk_cache(access.get(), 1, 0, 0));
  Handle created(H5Dcreate2(group, name, type, space.get(), H5P_DEFAULT, properties.get(), access.get()),
                 H5Dclose);
  check(created.ok() ? 0 : -1);
  return created;
}

Handle ObjectWriter::column(hid_t group, const Column& column, hsize_t chunk_rows) {
  Handle created =
      extensible_data_set(group, column.name, hdf5_type(column.number), column.width, chunk_rows);
  attribute(created.get(), "unit", column.unit, H5T_CSET_ASCII);
  attribute(created.get(), "frame", column.frame, H5T_CSET_ASCII);
  attribute(created.get(), "description", column.description(), H5T_CSET_ASCII);
  return created;
}

bool append_rows(const Handle& data_set, hid_t type, hsize_t width, hsize_t first, hsize_t rows,
                 const void* values) {
  const int rank = width == 1 ? 1 : 2;
  const hsize_t extent[2] = {first + rows, width}, start[2] = {first, 0}, size[2] = {rows, width};
  if (H5Dset_extent(data_set.get(), extent) < 0) return false;
  const Handle memory(H5Screate_simple(rank, size, nullptr), H5Sclose);
  const Handle space(H5Dget_space(data_set.get()), H5Sclose);
  return H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, start, nullptr, size, nullptr) >= 0 &&
         H5Dwrite(data_set.get(), type, memory.get(), space.get(), H5P_DEFAULT, values) >= 0;
}

std::string padded(const std::vector<std::string>& texts, std::size_t width) {
  std::string bytes(width * texts.size(), '\0');
  for (std::size_t i = 0; i < texts.size(); ++i) bytes.replace(i * width, texts[i].size(), texts[i]);
  return bytes;
}

}  // namespace palpate::internal
