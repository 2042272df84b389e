#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "recording/hdf5_handle.h"

/// Groups, attributes and data sets of a recording that is read. The file is untrusted: every type, shape and
/// layout is validated before values are read, and what is not as expected throws a Refusal.
namespace palpate::internal {

/// Consecutive ticks without their events: up to `count` from row `first` on.
struct RowRange {
  std::uint64_t first = 0, count = 0;
};

/// Thrown if a recording cannot be read; caught by send_recording().
struct Refusal {
  std::string what, remedy;  ///< As in Error.
};

/// Remaining decompression budget of a file.
struct DecompressionBudget {
  explicit DecompressionBudget(std::uint64_t file_bytes);
  std::uint64_t remaining_bytes;
};

/// Throws a Refusal for a damaged recording unless the condition holds.
void require(bool condition, const std::string& what);

/// Opens a group of the file itself; external and soft links are not followed.
Handle open_group(hid_t parent, const std::string& name);

/// Whether two types have equal class, size and sign; byte order may differ.
bool same_type(const Handle& type, hid_t ours);

/// Attribute with one value.
class Attribute {
 public:
  Attribute(hid_t object, const std::string& name);

  /// Text of a fixed-length string, at most kMaxText bytes.
  std::string text() const;

  /// @param type  the HDF5 type of Plain, which the attribute must have
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

void read_attribute(const Attribute& attribute, std::string& value);
void read_attribute(const Attribute& attribute, bool& value);
void read_attribute(const Attribute& attribute, std::uint32_t& value);
void read_attribute(const Attribute& attribute, std::uint64_t& value);
void read_attribute(const Attribute& attribute, double& value);
/// Reads a number of devices, 0 ... kMaxDevices.
void read_attribute(const Attribute& attribute, int& value);

/// Data set of rank 0 to 2, stored in the file itself.
class DataSet {
 public:
  /// @param group_name  name of `group` in errors
  DataSet(hid_t group, const std::string& group_name, const std::string& name);

  hsize_t rows() const { return dims_[0]; }
  /// Requires the shape [] for rank 0, [N] for rank 1, [N, width] for rank 2.
  void require_shape(int rank, hsize_t width = 1) const;
  void require_rows(hsize_t rows) const;
  void require_type(hid_t type) const;
  /// Requires that every row, or every row of a range, is stored: HDF5 would fill gaps with zeros. Charges
  /// the size of all rows to the budget.
  void require_stored(DecompressionBudget& budget, const std::optional<RowRange>& range = {}) const;

  void read_all(hid_t type, void* values) const;
  void read_rows(hid_t type, hsize_t first, hsize_t count, void* values) const;
  /// Fixed-length strings: one for rank 0, one per row for rank 1; at most kMaxNames bytes in total.
  /// @param largest  maximum length of the string type; bytes
  std::vector<std::string> texts(std::size_t largest) const;

 private:
  hsize_t rows_or_one() const;
  void require_chunks(const RowRange& range) const;
  void check_layout();

  std::string name_;
  Handle data_set_, type_, space_, properties_;
  int rank_ = 0;
  std::array<hsize_t, 2> dims_{0, 1}, chunk_{1, 1};
};

}  // namespace palpate::internal
