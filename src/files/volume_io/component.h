#pragma once

#include <cstddef>
#include <cstdint>

namespace palpate::volume_io {

/// Type of a voxel value in a file.
enum class Component { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kInt64, kUint64, kFloat32, kFloat64 };

std::size_t bytes_of(Component component);
const char* name_of(Component component);

/// Calls body with a default value of the component's C++ type, of which only the type is used.
template <class Body>
auto with_type(Component component, const Body& body) {
  switch (component) {
    case Component::kInt8:
      return body(std::int8_t{});
    case Component::kUint8:
      return body(std::uint8_t{});
    case Component::kInt16:
      return body(std::int16_t{});
    case Component::kUint16:
      return body(std::uint16_t{});
    case Component::kInt32:
      return body(std::int32_t{});
    case Component::kUint32:
      return body(std::uint32_t{});
    case Component::kInt64:
      return body(std::int64_t{});
    case Component::kUint64:
      return body(std::uint64_t{});
    case Component::kFloat32:
      return body(float{});
    case Component::kFloat64:
      break;
  }
  return body(double{});
}

}  // namespace palpate::volume_io
