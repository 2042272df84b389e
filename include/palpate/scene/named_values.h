#pragma once

#include <algorithm>
#include <array>
#include <string_view>

#include "palpate/scene/scene.h"

/// Names of the enumerators of a scene file.
namespace palpate {

/// Enumerator with its name in scene files, on the command line and in the protocol. The last entry of each
/// table is the fallback for unknown names.
template <class T>
struct NamedValue {
  T value;
  std::string_view name;
};
inline constexpr std::array kSides{
    NamedValue<Side>{Side::kLeft, "left"}, NamedValue<Side>{Side::kRight, "right"},
    NamedValue<Side>{Side::kBoth, "both"}, NamedValue<Side>{Side::kUnknown, "unknown"}};
inline constexpr std::array kModalities{NamedValue<Modality>{Modality::kCt, "ct"},
                                        NamedValue<Modality>{Modality::kMr, "mr"},
                                        NamedValue<Modality>{Modality::kUnknown, "unknown"}};
inline constexpr std::array kSurfaceAxes{NamedValue<SurfaceAxes>{SurfaceAxes::kLps, "lps"},
                                         NamedValue<SurfaceAxes>{SurfaceAxes::kRas, "ras"}};
inline constexpr std::array kSurfaceUnits{NamedValue<SurfaceUnit>{SurfaceUnit::kMm, "mm"},
                                          NamedValue<SurfaceUnit>{SurfaceUnit::kCm, "cm"},
                                          NamedValue<SurfaceUnit>{SurfaceUnit::kM, "m"}};
inline constexpr std::array kHeaderForms{NamedValue<HeaderForm>{HeaderForm::kQform, "q"},
                                         NamedValue<HeaderForm>{HeaderForm::kSform, "s"}};
/// The last entry is the default of a scene that does not set the law.
inline constexpr std::array kTissueLaws{NamedValue<TissueLaw>{TissueLaw::kElastic, "elastic"},
                                        NamedValue<TissueLaw>{TissueLaw::kNeoHookean, "neo-hookean"},
                                        NamedValue<TissueLaw>{TissueLaw::kExponential, "exponential"},
                                        NamedValue<TissueLaw>{TissueLaw::kChainMail, "chainmail"},
                                        NamedValue<TissueLaw>{TissueLaw::kLayers, "layers"}};
template <class T, std::size_t kCount>
constexpr T value_of(std::string_view name, const std::array<NamedValue<T>, kCount>& names) {
  const auto found = std::find_if(names.begin(), names.end(),
                                  [&](const NamedValue<T>& named) { return named.name == name; });
  return found == names.end() ? names.back().value : found->value;
}
template <class T, std::size_t kCount>
constexpr std::string_view name_of(T value, const std::array<NamedValue<T>, kCount>& names) {
  return std::find_if(names.begin(), names.end(),
                      [&](const NamedValue<T>& named) { return named.value == value; })
      ->name;
}

}  // namespace palpate
