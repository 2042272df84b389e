#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/contact/model.h"
#include "palpate/volume/bricks.h"

/// Volume rendering of structures on the CPU.
namespace palpate {

/// Appearance of a structure.
struct StructureAppearance {
  Rgb colour;
  double opacity = 1;  ///< 0: invisible; 1: opaque; between: its surface is visible, and what lies behind it
};
/// Appearances by LabelId as the scene defines them (palpate/contact/colours.h); labels without a tissue are
/// opaque.
std::vector<StructureAppearance> structure_appearances(const Model& model);

/// Appearance of the scan as a haze around the structures: the brighter, the denser. Invisible in voxels that
/// structures cover by more than half.
struct ScanAppearance {
  std::shared_ptr<const Volume<float>> scan;  ///< On the grid of the labels; null: not drawn
  std::array<double, 2> window{0, 1};         ///< Values for black and white, ascending
  double opacity = 1;                         ///< 0 ... 1
};
/// Maximum size of a scan: nearly all its voxels are prepared, 32 bytes each.
inline constexpr std::size_t kMaxScanVoxels = std::size_t{64} << 20;

/// Camera: rays through the centres of a picture's pixels.
struct VolumeCamera {
  Point<Patient> focus;   ///< Centre of the picture
  Vector<Patient> right;  ///< Unit vector to the picture's right
  Vector<Patient> down;   ///< Unit vector to the picture's bottom, orthogonal to `right`
  double width_mm = 200;  ///< Width of the picture at the focus
  int width_px = 512, height_px = 512;
  /// Distance from the eye to the focus, positive; infinite: parallel rays. Anything behind the eye is
  /// invisible.
  double eye_mm = std::numeric_limits<double>::infinity();

  bool is_parallel() const { return eye_mm == std::numeric_limits<double>::infinity(); }
  double mm_per_px() const { return width_mm / width_px; }
  Vector<Patient> into() const { return right.cross(down); }  ///< Unit vector away from the viewer
  /// Position of a pixel (centre 0, 0) in the plane through the focus that faces the viewer.
  Point<Patient> at(double column, double row) const;
};

/// Clip plane: the half-space to which `away` points is not drawn.
struct ClipPlane {
  Point<Patient> at;
  Vector<Patient> away;  ///< Any length but 0
};

/// Reflection coefficients of surfaces, 0 ... 1 each. One light is a headlight along the picture's central
/// ray, the other, the key light, is fixed to the camera. The page has the same
/// (web/src/volume/shading.gen.ts).
struct VolumeLight {
  double ambient = 0.22;   ///< Independent of the normal
  double diffuse = 0.46;   ///< Proportional to the cosine between normal and headlight
  double specular = 0.05;  ///< White, proportional to the 20th power of that cosine
  double key = 0.34;       ///< Proportional to the cosine between the outward normal and the key light
  /// Direction towards the key light: components to the picture's right, to its top and to the viewer; any
  /// length but 0.
  std::array<double, 3> key_direction{-0.45, 0.6, 0.66};
};

/// Background, light and clipping of a picture.
struct VolumeStyle {
  Rgb background{9, 12, 14};
  VolumeLight light;
  std::optional<ClipPlane> clip;
};

namespace internal::volume_picture {
class VolumeEncoding;
struct Scratch;
}  // namespace internal::volume_picture

/// Renders the structures of a label volume by shear-warp factorisation (Lacroute & Levoy 1994), from any
/// direction, in parallel or perspective projection. docs/guide/render.md describes the pictures,
/// docs/decisions/archive/0045-shear-warp.md the method and its errors. Not thread-safe; uses several threads
/// internally. Bit-identical on every SIMD target and for any number of threads.
class VolumeRenderer {
 public:
  /// @param appearances  by LabelId; labels beyond it are not drawn
  /// @param threads      0: one per CPU
  /// @param scan         shared for the lifetime of the renderer
  /// Errors: kInterrupted.
  static Result<VolumeRenderer> make(const Bricks<LabelId>& labels,
                                     std::span<const StructureAppearance> appearances, int threads = 0,
                                     const Progress& progress = {}, ScanAppearance scan = {});
  VolumeRenderer(VolumeRenderer&&) noexcept;
  VolumeRenderer& operator=(VolumeRenderer&&) noexcept;
  ~VolumeRenderer();

  /// Updates the labels within a box, outside of which nothing may have changed; costs in proportion to the
  /// box.
  void change(const Bricks<LabelId>& labels, const VoxelBox& box);

  /// @param rgb       3 * width_px * height_px, row 0 at the top
  /// @param depth_mm  width_px * height_px, or empty: distance along its ray, from the eye or, for parallel
  ///                  rays, from the plane through the focus, at which a pixel's accumulated opacity exceeds
  ///                  one half; infinite if it does not
  void render(const VolumeCamera& camera, const VolumeStyle& style, std::span<std::uint8_t> rgb,
              std::span<float> depth_mm = {});

  std::size_t prepared_bytes() const;

 private:
  VolumeRenderer();
  std::unique_ptr<internal::volume_picture::VolumeEncoding> encoding_;
  std::unique_ptr<internal::volume_picture::Scratch> scratch_;
  int threads_ = 0;
};

}  // namespace palpate
