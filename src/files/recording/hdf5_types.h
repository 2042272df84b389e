#pragma once

#include "recording/columns.h"
#include "recording/hdf5_handle.h"

namespace palpate::internal {

/// File type, little-endian, which is the memory type as well.
inline hid_t hdf5_type(Number number) {
  switch (number) {
    case Number::kU8:
      return H5T_STD_U8LE;
    case Number::kU16:
      return H5T_STD_U16LE;
    case Number::kU32:
      return H5T_STD_U32LE;
    case Number::kU64:
      return H5T_STD_U64LE;
    case Number::kF64:
      break;
  }
  return H5T_IEEE_F64LE;
}

}  // namespace palpate::internal
