#pragma once

#include <string>
#include <vector>

#include "palpate/phantoms/phantoms.h"
#include "palpate/phantoms/primitives.h"

namespace palpate {

/// Material of a part, which determines its appearance in the scan.
enum class PhantomMaterial : std::uint8_t {
  kFat,
  kMuscle,
  kFluid,
  kBone,  ///< Bright marrow in a dark cortical rim (MR), or the reverse (CT).
  kCartilage,
  kMeniscus,
  kLigament,
  kVessel,
  kLesion,
  kInvisible,  ///< Invisible: the scan shows the material around it.
  kGland,
  kSkin,
  kBrain,
  kPlastic,
};

/// Structure of a phantom.
struct PhantomPart {
  std::string name;
  LabelId label = 0;  ///< 0: visible in the scan but not segmented.
  Rgb colour;
  PhantomMaterial material;
  Shape shape;
};

enum class PhantomImaging : std::uint8_t {
  kProtonDensity,  ///< MR without fat suppression, arbitrary units, with coil shading and Rician noise.
  kCt,             ///< HU, Gaussian noise.
};

/// Extent of a phantom's volume. Parts are defined in the anatomy's own millimetres, which `scale` maps to
/// the patient's, axis by axis.
struct PhantomField {
  Eigen::Vector3d extent_mm, middle_mm;  ///< Extent and centre in the anatomy's millimetres.
  Eigen::Vector3d scale{1, 1, 1};

  GridGeometry grid(const Eigen::Vector3d& spacing_mm) const;
};

/// Complete description of a phantom, without voxels.
struct PhantomPlan {
  PhantomField field;
  PhantomImaging imaging = PhantomImaging::kProtonDensity;
  bool mirrored = false;           ///< The finished volume is mirrored in x.
  std::vector<PhantomPart> parts;  ///< At a point in several parts the last one applies.
};

PhantomField field_of(const KneeParameters& knee);
PhantomField field_of(const ShellParameters& shell);
PhantomField field_of(const SkullParameters& skull);
PhantomField field_of(const GlandParameters& gland);
PhantomField field_of(const BlockParameters& block);
PhantomField field_of(const DomeParameters& dome);
PhantomField field_of(const AbdomenParameters& abdomen);
PhantomField field_of(const TemporalBoneParameters& bone);

PhantomPlan plan_of(const KneeParameters& knee);
PhantomPlan plan_of(const ShellParameters& shell);
PhantomPlan plan_of(const SkullParameters& skull);
PhantomPlan plan_of(const GlandParameters& gland);
PhantomPlan plan_of(const BlockParameters& block);
PhantomPlan plan_of(const DomeParameters& dome);
PhantomPlan plan_of(const AbdomenParameters& abdomen);
PhantomPlan plan_of(const TemporalBoneParameters& bone);

/// Segments of a plan's labels, in ascending order.
std::vector<Segment> segments_of(const PhantomPlan& plan);
/// Generates the voxels of a plan: paints the parts in order, then adds segmentation errors and scan noise.
/// Errors: kInterrupted.
Result<Phantom> paint_phantom(const PhantomPlan& plan, const PhantomSettings& settings,
                              const Progress& progress);

}  // namespace palpate
