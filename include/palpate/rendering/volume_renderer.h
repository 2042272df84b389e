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
#include "palpate/haptics/haptics.h"
#include "palpate/volume/bricks.h"

/// Pictures of structures in three dimensions, by the processor alone.
namespace palpate {

/// How a structure is drawn.
struct StructureLook {
  Rgb colour;
  double opacity = 1;  ///< 0: not at all; 1: solid; between: its surface is seen, and what lies behind
};
/// By LabelId, as the scene says (palpate/haptics/colours.h); what belongs to no tissue is solid.
std::vector<StructureLook> structure_looks(const Model& model);

/// The scan as a haze around the structures: the brighter, the denser. Where they cover more than half of a
/// voxel it is not seen.
struct ScanLook {
  std::shared_ptr<const Volume<float>> scan;  ///< on the grid of the labels; null: not drawn
  std::array<double, 2> window{0, 1};         ///< from black to white, the first below the second
  double opacity = 1;                         ///< 0 ... 1
};
/// Each voxel that is drawn is prepared: of a scan nearly all are, 32 bytes each.
inline constexpr std::size_t kMostScanVoxels = std::size_t{64} << 20;

/// What is seen: rays through the middles of a picture's pixels.
struct VolumeCamera {
  Point<Patient> focus;   ///< shown in the middle of the picture
  Vector<Patient> right;  ///< unit, to the picture's right
  Vector<Patient> down;   ///< unit, to the picture's bottom, orthogonal to `right`
  double width_mm = 200;  ///< of the picture, at the focus
  int width_px = 512, height_px = 512;
  /// From the eye to the focus, above 0; infinite: rays are parallel. What lies behind the eye is not seen.
  double eye_mm = std::numeric_limits<double>::infinity();

  bool is_parallel() const { return eye_mm == std::numeric_limits<double>::infinity(); }
  double mm_per_px() const { return width_mm / width_px; }
  Vector<Patient> into() const { return right.cross(down); }  ///< unit, away from the viewer
  /// Where a pixel (centre 0, 0) lies in the plane through the focus that faces the viewer.
  Point<Patient> at(double column, double row) const;
};

/// What lies on the side to which `away` points is not drawn.
struct ClipPlane {
  Point<Patient> at;
  Vector<Patient> away;  ///< any length but 0
};

/// How much light surfaces give back, 0 ... 1 each. The light shines along the picture's middle ray.
struct VolumeLight {
  double ambient = 0.28;   ///< wherever they face
  double diffuse = 0.68;   ///< by the cosine to the light
  double specular = 0.08;  ///< white, by its 20th power
};

struct VolumeStyle {
  Rgb background{9, 12, 14};
  VolumeLight light;
  std::optional<ClipPlane> clip;
};

namespace internal::volume_picture {
class Encoding;
struct Scratch;
}  // namespace internal::volume_picture

/// Draws the structures of a label volume by shear-warp (Lacroute & Levoy 1994) from any side, parallel or in
/// perspective. What a picture shows is said in docs/guide/render.md, how it is made and how far it is off in
/// docs/decisions/0045-shear-warp.md. For one thread at a time; the work itself is done by several. The same
/// bits on every SIMD target and with any number of threads.
class VolumeRenderer {
 public:
  /// @param looks    by LabelId; labels beyond have none and are not drawn
  /// @param threads  0: as many as there are processors
  /// @param scan     is kept as long as the renderer is
  /// Errors: kInterrupted.
  static Result<VolumeRenderer> make(const Bricks<LabelId>& labels, std::span<const StructureLook> looks,
                                     int threads = 0, const Progress& progress = {}, ScanLook scan = {});
  VolumeRenderer(VolumeRenderer&&) noexcept;
  VolumeRenderer& operator=(VolumeRenderer&&) noexcept;
  ~VolumeRenderer();

  /// Labels that differ from those before in a box of the grid and nowhere else: costs what the box does.
  void change(const Bricks<LabelId>& labels, const VoxelBox& box);

  /// @param rgb       3 * width_px * height_px, row 0 on top
  /// @param depth_mm  width_px * height_px, or empty: how far along its ray, from the eye or, of parallel
  ///                  rays, from the plane through the focus, a pixel becomes more covered than not; infinite
  ///                  where it does not
  void render(const VolumeCamera& camera, const VolumeStyle& style, std::span<std::uint8_t> rgb,
              std::span<float> depth_mm = {});

  std::size_t prepared_bytes() const;

 private:
  VolumeRenderer();
  std::unique_ptr<internal::volume_picture::Encoding> encoding_;
  std::unique_ptr<internal::volume_picture::Scratch> scratch_;
  int threads_ = 0;
};

}  // namespace palpate
