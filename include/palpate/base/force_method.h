#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

/// Names of the force methods. docs/concepts/methods.md gives their equations, force_field.h their behaviour.
namespace palpate {

/// Method that computes the force from voxels. The values are stored in recordings.
enum class ForceMethod : std::uint8_t {
  kTrilinear = 0,       ///< Trilinear interpolation of the field, central differences, as published.
  kSpline = 1,          ///< Cubic B-spline of the field, analytic gradient.
  kGaussianSphere = 2,  ///< Gaussian-weighted raw labels, evaluated at run time, as published.
  kSmoothSphere = 3,    ///< Raw labels through a compact smooth kernel, analytic gradient.
  kStoredNormals = 4,   ///< Magnitude and normal stored with every voxel, as published.
  kProxy = 5,           ///< God-object (proxy) constrained outside every structure's own surface.
};

struct ForceMethodInfo {
  ForceMethod method;
  std::string_view name;   ///< Identifier in scenes, on the command line and in figures.
  std::string_view about;  ///< Short description for users.
};

/// All force methods, in the order of their values.
inline constexpr std::array kForceMethods{
    ForceMethodInfo{ForceMethod::kTrilinear, "trilinear", "trilinear interpolation, central differences"},
    ForceMethodInfo{ForceMethod::kSpline, "b-spline", "cubic B-spline, analytic gradient"},
    ForceMethodInfo{ForceMethod::kGaussianSphere, "gaussian-sphere",
                    "Gaussian sphere on raw labels, as published"},
    ForceMethodInfo{ForceMethod::kSmoothSphere, "smooth-sphere", "smooth sphere on raw labels"},
    ForceMethodInfo{ForceMethod::kStoredNormals, "stored-normals",
                    "magnitude and normal stored with every voxel"},
    ForceMethodInfo{ForceMethod::kProxy, "proxy", "proxy constrained by the surface of every structure"},
};
/// Stateless methods: the force depends on the tip position alone.
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
/// Next method, cyclically.
constexpr ForceMethod next_of(ForceMethod method) {
  return kForceMethods[(index_of(method) + 1) % kForceMethods.size()].method;
}

}  // namespace palpate
