#pragma once

#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <string>
#include <vector>

#include "recording/columns.h"
#include "recording/hdf5_handle.h"

/// Groups, attributes and data sets of a recording that is being written.
namespace palpate::internal {

/// String type of a fixed length in bytes, padded with zeros.
Handle fixed_text_type(std::size_t size, H5T_cset_t characters);

/// Writes groups, attributes and data sets; ok() is true if all calls succeeded.
class ObjectWriter {
 public:
  explicit ObjectWriter(hid_t file) : file_(file) {}
  bool ok() const { return ok_; }

  Handle group(const char* name);

  void raw_attribute(hid_t object, const char* name, hid_t type, const void* value);
  void attribute(hid_t object, const char* name, const std::string& text,
                 H5T_cset_t characters = H5T_CSET_UTF8) {
    raw_attribute(object, name, fixed_text_type(text.size(), characters).get(), text.c_str());
  }
  void attribute(hid_t object, const char* name, std::uint64_t value) {
    raw_attribute(object, name, H5T_STD_U64LE, &value);
  }
  void attribute(hid_t object, const char* name, std::uint32_t value) {
    raw_attribute(object, name, H5T_STD_U32LE, &value);
  }
  void attribute(hid_t object, const char* name, double value) {
    raw_attribute(object, name, H5T_IEEE_F64LE, &value);
  }
  void attribute(hid_t object, const char* name, int value) {
    attribute(object, name, static_cast<std::uint32_t>(value));
  }
  void attribute(hid_t object, const char* name, bool value) {
    const auto byte = static_cast<std::uint8_t>(value);
    raw_attribute(object, name, H5T_STD_U8LE, &byte);
  }

  /// Creates a fixed-size data set with its content.
  Handle data_set(hid_t group, const char* name, hid_t type, std::initializer_list<hsize_t> dims,
                  const void* values);

  /// Creates an extensible data set without rows.
  Handle extensible_data_set(hid_t group, const char* name, hid_t type, hsize_t width, hsize_t chunk_rows);

  /// Creates the extensible data set of a column, with its unit, frame and description.
  Handle column(hid_t group, const Column& column, hsize_t chunk_rows);

  void check(herr_t status) { ok_ = ok_ && status >= 0; }

 private:
  hid_t file_;
  bool ok_ = true;
};

/// Appends `rows` rows to an extensible data set that has `first` rows; false if HDF5 fails.
bool append_rows(const Handle& data_set, hid_t type, hsize_t width, hsize_t first, hsize_t rows,
                 const void* values);

/// Texts as one block of equal lengths of `width` bytes, padded with zeros.
std::string padded(const std::vector<std::string>& texts, std::size_t width);

}  // namespace palpate::internal
