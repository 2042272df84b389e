#pragma once

#include <string>
#include <vector>

#include "palpate/phantoms/phantoms.h"
#include "palpate/phantoms/primitives.h"

namespace palpate {

/// What a part of a phantom is made of, as a scanner sees it.
enum class PhantomMaterial : std::uint8_t {
  kFat,
  kMuscle,
  kFluid,
  kBone,  ///< bright marrow in a dark cortical rim (MR), or the other way round (CT)
  kCartilage,
  kMeniscus,
  kLigament,
  kVessel,
  kLesion,
  kUnseen,  ///< the scan shows what it lies in
  kGland,
  kSkin,
  kBrain,
  kPlastic,
};

/// One structure of a phantom.
struct PhantomPart {
  std::string name;
  LabelId label = 0;  ///< 0: seen in the scan, not segmented
  Rgb colour;
  PhantomMaterial material;
  Shape shape;
};

enum class PhantomImaging : std::uint8_t {
  kProtonDensity,  ///< MR without fat suppression, arbitrary units, a coil's shading, Rician noise
  kCt,             ///< HU, Gaussian noise
};

/// Where a phantom's volume lies. Parts are made in the anatomy's own millimetres, which `scale` maps to the
/// patient's, axis by axis.
struct PhantomField {
  Eigen::Vector3d extent_mm, middle_mm;  ///< the anatomy's
  Eigen::Vector3d scale{1, 1, 1};

  GridGeometry grid(const Eigen::Vector3d& spacing_mm) const;
};

/// All of a phantom but its voxels.
struct PhantomPlan {
  PhantomField field;
  PhantomImaging imaging = PhantomImaging::kProtonDensity;
  bool mirrored = false;           ///< in x, when it is done
  std::vector<PhantomPart> parts;  ///< where two share a point the later one is there
};

PhantomField field_of(const KneeParameters& knee);
PhantomField field_of(const ShellParameters& shell);
PhantomField field_of(const SkullParameters& skull);
PhantomField field_of(const GlandParameters& gland);
PhantomField field_of(const BlockParameters& block);
PhantomField field_of(const DomeParameters& dome);
PhantomField field_of(const AbdomenParameters& abdomen);

PhantomPlan plan_of(const KneeParameters& knee);
PhantomPlan plan_of(const ShellParameters& shell);
PhantomPlan plan_of(const SkullParameters& skull);
PhantomPlan plan_of(const GlandParameters& gland);
PhantomPlan plan_of(const BlockParameters& block);
PhantomPlan plan_of(const DomeParameters& dome);
PhantomPlan plan_of(const AbdomenParameters& abdomen);

/// The segments of a plan's labels, ascending.
std::vector<Segment> segments_of(const PhantomPlan& plan);
/// Voxels of a plan: parts painted one over the other, then the faults of a segmentation and the scan's
/// noise. Errors: kInterrupted.
Result<Phantom> paint_phantom(const PhantomPlan& plan, const PhantomSettings& settings,
                              const Progress& progress);

}  // namespace palpate
