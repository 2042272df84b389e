#include "recording/commit_driver.h"

#include <cerrno>
#include <limits>
#include <new>

namespace palpate::internal {
namespace {

// HDF5 expects its base struct at the beginning of the driver's struct
struct OpenFile {
  H5FD_t base;
  CommitFile* file;
};
// passed by the property list to open()
struct DriverInfo {
  CommitFile* file;
};

CommitFile& file_of(const H5FD_t* base) {
  return *reinterpret_cast<const OpenFile*>(base)->file;
}

H5FD_t* open_file(const char*, unsigned, hid_t access, haddr_t) {
  const auto* info = static_cast<const DriverInfo*>(H5Pget_driver_info(access));
  if (info == nullptr) return nullptr;
  auto* opened = new (std::nothrow) OpenFile{{}, info->file};
  return opened == nullptr ? nullptr : &opened->base;
}

herr_t close_file(H5FD_t* base) {
  delete reinterpret_cast<OpenFile*>(base);
  return 0;
}

// no accumulation or aggregation: every block of metadata arrives as one write
herr_t query(const H5FD_t*, unsigned long* flags) {
  *flags = 0;
  return 0;
}

haddr_t end_of_allocation(const H5FD_t* base, H5FD_mem_t) {
  return file_of(base).end();
}

herr_t set_end_of_allocation(H5FD_t* base, H5FD_mem_t, haddr_t end) {
  file_of(base).set_end(end);
  return 0;
}

herr_t read(H5FD_t* base, H5FD_mem_t, hid_t, haddr_t offset, std::size_t size, void* buffer) {
  return file_of(base).read(offset, {static_cast<std::byte*>(buffer), size}) ? 0 : -1;
}

// Reports success to HDF5 even if the write failed, because HDF5 would no longer close its files after an
// error. CommitFile stores the error and drops the following writes.
herr_t write(H5FD_t* base, H5FD_mem_t, hid_t, haddr_t offset, std::size_t size, const void* buffer) {
  try {
    file_of(base).write(offset, {static_cast<const std::byte*>(buffer), size});
  } catch (const std::bad_alloc&) {
    // exceptions must not propagate through HDF5
    file_of(base).fail(ENOMEM);
  }
  return 0;
}

hid_t register_driver() {
  H5FD_class_t driver{};
  driver.name = "palpate_commit";
  driver.maxaddr = std::numeric_limits<std::int64_t>::max();
  driver.fc_degree = H5F_CLOSE_WEAK;
  driver.fapl_size = sizeof(DriverInfo);
  driver.open = open_file;
  driver.close = close_file;
  driver.query = query;
  driver.get_eoa = end_of_allocation;
  driver.set_eoa = set_end_of_allocation;
  driver.get_eof = end_of_allocation;
  driver.read = read;
  driver.write = write;
  return H5FDregister(&driver);
}

}  // namespace

Handle access_through(CommitFile& file) {
  static const hid_t driver = register_driver();
  Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  const DriverInfo info{&file};
  if (driver < 0 || H5Pset_driver(access.get(), driver, &info) < 0) return {};
  return access;
}

bool commit(const Handle& hdf5_file, CommitFile& file) {
  return H5Fflush(hdf5_file.get(), H5F_SCOPE_LOCAL) >= 0 && file.commit();
}

}  // namespace palpate::internal
