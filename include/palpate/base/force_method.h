#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

/// The names of the ways from voxels to a force. docs/concepts/methods.md has their equations, force_field.h
/// what they do.
namespace palpate {

/// The numbers stand in recordings.
enum class ForceMethod : std::uint8_t {
  kTrilinear = 0,       ///< trilinear interpolation of the field + central differences, as published
  kSpline = 1,          ///< cubic B-spline of the field, analytic gradient
  kGaussianSphere = 2,  ///< Gaussian-weighted raw labels at run time, as published
  kSmoothSphere = 3,    ///< raw labels through a compact smooth kernel, analytic gradient
  kStoredNormals = 4,   ///< magnitude and normal of every voxel, as published
  kProxy = 5,           ///< a proxy on every structure's own surface, which keeps the tool out
};

struct ForceMethodInfo {
  ForceMethod method;
  std::string_view name;   ///< in scenes, on the command line, in figures
  std::string_view about;  ///< for people, a few words
};

/// All of them, in the order of their numbers.
inline constexpr std::array kForceMethods{
    ForceMethodInfo{ForceMethod::kTrilinear, "trilinear", "trilinear interpolation, central differences"},
    ForceMethodInfo{ForceMethod::kSpline, "b-spline", "cubic B-spline, analytic gradient"},
    ForceMethodInfo{ForceMethod::kGaussianSphere, "gaussian-sphere",
                    "Gaussian sphere on raw labels, as published"},
    ForceMethodInfo{ForceMethod::kSmoothSphere, "smooth-sphere", "smooth sphere on raw labels"},
    ForceMethodInfo{ForceMethod::kStoredNormals, "stored-normals",
                    "magnitude and normal stored with every voxel"},
    ForceMethodInfo{ForceMethod::kProxy, "proxy", "a proxy held out by every structure's surface"},
};
/// Those that need no memory: the force follows from where the tip is.
inline constexpr std::span<const ForceMethodInfo, 5> kDirectMethods = std::span(kForceMethods).first<5>();

constexpr std::size_t index_of(ForceMethod method) {
  return static_cast<std::size_t>(method);
}
constexpr std::string_view name_of(ForceMethod method) {
  return kForceMethods[index_of(method)].name;
}
constexpr std::optional<ForceMethod> find_force_method(std::string_view name) {
  const auto found = std::find_if(kForceMethods.begin(), kForceMethods.end(),
                                  [&](const ForceMethodInfo& info) { return info.name == name; });
  return found == kForceMethods.end() ? std::nullopt : std::optional(found->method);
}
/// The one after it, in a circle.
constexpr ForceMethod next_of(ForceMethod method) {
  return kForceMethods[(index_of(method) + 1) % kForceMethods.size()].method;
}

}  // namespace palpate
