#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <random>

#include "base/test_files.h"
#include "base/test_seed.h"
#include "volume_io/formats/formats.h"
#include "volume_io/formats/itk_oracle.h"

// The place of a volume in the patient as our parsers read it from its header, compared with ITK's readers:
// the same numbers to the last bit, so that a run on a scan has the same hash whichever of them reads it.
namespace palpate::volume_io {
namespace {

using test::TemporaryFolder;
using test::write_text;

Result<GridGeometry> ours_of(const std::filesystem::path& file) {
  const auto format = format_of(file);
  if (!format) return format.error();
  OtherFiles others;
  const auto volume = inspect_file(**format, file, others, {});
  if (!volume) return volume.error();
  return volume->header.geometry;
}

ItkFormat itk_format_of(const std::filesystem::path& file) {
  const auto format = format_of(file);
  EXPECT_TRUE(format.ok());
  return (*format)->writer;
}

::testing::AssertionResult equals_itk(const std::filesystem::path& file) {
  const auto ours = ours_of(file);
  const auto itk = testing::itk_grid_of(itk_format_of(file), file);
  if (!ours && !itk) return ::testing::AssertionSuccess();
  if (!ours) return ::testing::AssertionFailure() << "ITK accepts what we reject: " << ours.error().message();
  if (!itk) return ::testing::AssertionFailure() << "ITK rejects what we accept";
  const auto differs = [](const char* what, int n, double one, double other) {
    char text[120];
    std::snprintf(text, sizeof text, "%s %d: ours %a, ITK's %a (%.9g, %.9g)", what, n, one, other, one,
                  other);
    return ::testing::AssertionFailure() << text;
  };
  if (ours->dims != itk->dims) return ::testing::AssertionFailure() << "dims";
  for (int a = 0; a < 3; ++a) {
    const auto n = static_cast<std::size_t>(a);
    if (ours->spacing_mm[a] != itk->spacing_mm[n])
      return differs("spacing", a, ours->spacing_mm[a], itk->spacing_mm[n]);
    if (ours->origin[a] != itk->origin_mm[n]) return differs("origin", a, ours->origin[a], itk->origin_mm[n]);
    for (int r = 0; r < 3; ++r)
      if (ours->direction(r, a) != itk->columns[n][static_cast<std::size_t>(r)])
        return differs("direction", 3 * r + a, ours->direction(r, a),
                       itk->columns[n][static_cast<std::size_t>(r)]);
  }
  return ::testing::AssertionSuccess();
}

std::string text_of(double number) {
  char text[40];
  std::snprintf(text, sizeof text, "%.17g", number);
  return text;
}

class HeaderGeometry : public ::testing::Test {
 protected:
  HeaderGeometry() : random_(test::test_seed()) {}

  double uniform(double low, double high) { return std::uniform_real_distribution<>(low, high)(random_); }
  // rows of an orthogonal, possibly mirrored and permuted matrix, sometimes along the axes
  Eigen::Matrix3d some_directions() {
    Eigen::Matrix3d directions = Eigen::Matrix3d::Identity();
    if (random_() % 2)
      directions = Eigen::Quaterniond(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1), uniform(0.1, 1))
                       .normalized()
                       .toRotationMatrix();
    if (random_() % 2) directions.col(0).swap(directions.col(2));
    if (random_() % 2) directions.col(1) *= -1;
    return directions;
  }

  std::mt19937 random_;
  const TemporaryFolder folder_;
  const ::testing::ScopedTrace trace_{__FILE__, __LINE__,
                                      "PALPATE_TEST_SEED=" + std::to_string(test::test_seed())};
};

std::string nrrd_of(int axes, const std::string& more) {
  std::string sizes;
  for (int a = 0; a < axes; ++a) sizes += a == 0 ? "2" : a < 3 ? " 3" : " 1";
  return "NRRD0004\ntype: uint8\ndimension: " + std::to_string(axes) + "\n" + more + "sizes: " + sizes +
         "\nencoding: ascii\n";
}

std::string vector_text(const Eigen::Vector3d& v) {
  return "(" + text_of(v.x()) + "," + text_of(v.y()) + "," + text_of(v.z()) + ")";
}

TEST_F(HeaderGeometry, NrrdEqualsItk) {
  const std::string spaces[] = {"left-posterior-superior", "LPS",         "RAS",
                                "right-anterior-superior", "scanner-xyz", "3D-right-handed",
                                "3D-left-handed"};
  for (int round = 0; round < 200; ++round) {
    const std::string& space = spaces[random_() % std::size(spaces)];
    const Eigen::Matrix3d directions = some_directions();
    std::string text = "space: " + space + "\nsizes: 2 3 3\nspace directions:";
    for (int a = 0; a < 3; ++a) text += " " + vector_text(uniform(0.1, 3) * directions.col(a));
    text += "\nspace origin: " +
            vector_text(Eigen::Vector3d(uniform(-200, 200), uniform(-200, 200), uniform(-200, 200))) + "\n";
    text = "NRRD0004\ntype: uint8\ndimension: 3\n" + text + "encoding: ascii\n";
    ASSERT_TRUE(equals_itk(write_text(folder_ / "a.nrrd", text + "\n"))) << text;
  }
}

// ITK negates the first axis instead, and mirrors the patient.
TEST_F(HeaderGeometry, SecondAxisOfLeftAnteriorSuperiorIsNegated) {
  for (const std::string space : {"left-anterior-superior", "LAS"}) {
    const auto place = ours_of(write_text(
        folder_ / "a.nrrd", nrrd_of(3, "space: " + space + "\n") +
                                "space directions: (2,0,0) (0,3,0) (0,0,4)\nspace origin: (5,6,7)\n\n"));
    ASSERT_TRUE(place) << place.error().message();
    EXPECT_EQ(place->spacing_mm, Eigen::Vector3d(2, 3, 4));
    EXPECT_EQ(place->origin, Point<Patient>(5, -6, 7));
    EXPECT_EQ(Eigen::Matrix3d(place->direction), Eigen::Matrix3d(Eigen::Vector3d(1, -1, 1).asDiagonal()));
  }
}

TEST_F(HeaderGeometry, NrrdWithoutDirectionsEqualsItk) {
  for (const std::string& text :
       {nrrd_of(3, ""), nrrd_of(2, ""), nrrd_of(3, "space: LPS\n"), nrrd_of(3, "space dimension: 3\n"),
        nrrd_of(3, "space: LPS\n") + "space origin: (1,2,3)\n",
        nrrd_of(3, "space: RAS\n") + "space origin: (1,2,3)\n",
        nrrd_of(3, "space: LPS\n") + "space origin: none\n", nrrd_of(3, "") + "spacings: 0.7 0.7 1.3\n",
        nrrd_of(2, "") + "spacings: 0.7 1.3\n",
        nrrd_of(3, "") + "spacings: 0.7 0.7 1.3\naxis mins: -3 4 5.5\n",
        nrrd_of(3, "") + "spacings: 0.7 0.7 1.3\naxis mins: -3 4 5.5\ncenters: node node cell\n",
        // NaN is NRRD's text for a number that is not known
        nrrd_of(3, "") + "spacings: 0.7 0.7 1.3\naxis mins: nan nan nan\n",
        nrrd_of(3, "") + "axis mins: -3 4 5.5\n", nrrd_of(3, "") + "axis mins: -3 4 5.5\naxis maxs: 1 9 7\n",
        nrrd_of(3, "") + "spacings: 0.7 0.7 1.3\naxis mins: -3 4 5.5\naxis maxs: 1 9 7\n",
        nrrd_of(2, "space dimension: 2\n") + "space directions: (0,2) (1,0)\nspace origin: (3,4)\n"})
    EXPECT_TRUE(equals_itk(write_text(folder_ / "a.nrrd", text + "\n"))) << text;
}

TEST_F(HeaderGeometry, ContradictoryNrrdIsRejectedAsByItk) {
  for (const std::string& text :
       {nrrd_of(3, "") + "space directions: (1,0,0) (0,1,0) (0,0,1)\n",
        nrrd_of(3, "") + "space origin: (1,2,3)\n", nrrd_of(3, "space: LPS\n") + "spacings: 1 1 2\n",
        nrrd_of(2, "space: LPS\n"), nrrd_of(3, "space: nowhere\n"),
        nrrd_of(3, "") + "spacings: 0.7 0.7 1.3\naxis mins: inf 4 5.5\n",
        nrrd_of(3, "") + "spacings: inf 0.7 1.3\n", nrrd_of(3, "") + "spacings: 0 0.7 1.3\n",
        nrrd_of(3, "space: LPS\nspace dimension: 3\n"), nrrd_of(3, "space: LPS\n") + "space origin: (1,2)\n",
        nrrd_of(3, "space: LPS\n") + "space directions: (1,0) (0,1) (0,0)\n"}) {
    const auto file = write_text(folder_ / "a.nrrd", text + "\n");
    EXPECT_FALSE(ours_of(file)) << text;
    EXPECT_FALSE(testing::itk_grid_of(ItkFormat::kNrrd, file)) << text;
  }
}

// ITK reads NaN as a position, drops known positions, or takes 1 mm for a spacing that is not known.
TEST_F(HeaderGeometry, PartlyKnownNrrdIsRejectedThoughItkReadsIt) {
  for (const std::string& text : {nrrd_of(3, "") + "spacings: 0.7 0.7 1.3\naxis mins: nan 4 5.5\n",
                                  nrrd_of(3, "") + "spacings: 0.7 0.7 1.3\naxis mins: -3 4 NaN\n",
                                  nrrd_of(3, "") + "spacings: 0.7 nan 1.3\naxis mins: -3 4 5.5\n",
                                  nrrd_of(3, "") + "spacings: nan nan nan\n"}) {
    const auto file = write_text(folder_ / "a.nrrd", text + "\n");
    EXPECT_FALSE(ours_of(file)) << text;
    EXPECT_TRUE(testing::itk_grid_of(ItkFormat::kNrrd, file)) << text;
  }
}

TEST_F(HeaderGeometry, MetaImageEqualsItk) {
  for (int round = 0; round < 200; ++round) {
    const Eigen::Matrix3d directions = some_directions();
    std::string text = "ObjectType = Image\nNDims = 3\nDimSize = 2 3 3\nElementType = MET_UCHAR\n";
    if (random_() % 3) {
      text += "TransformMatrix =";
      for (int a = 0; a < 3; ++a)
        for (int r = 0; r < 3; ++r) text += " " + text_of(directions(r, a));
      text += "\n";
    }
    const char* origins[] = {"Offset", "Position", "Origin"};
    if (random_() % 3)
      text += std::string(origins[random_() % 3]) + " = " + text_of(uniform(-200, 200)) + " " +
              text_of(uniform(-200, 200)) + " " + text_of(uniform(-200, 200)) + "\n";
    if (random_() % 3)
      text += std::string(random_() % 4 ? "ElementSpacing" : "ElementSize") + " = " +
              text_of(uniform(0.1, 3)) + " " + text_of(uniform(0.1, 3)) + " " + text_of(uniform(0.1, 3)) +
              "\n";
    text += "ElementDataFile = LOCAL\n";
    ASSERT_TRUE(equals_itk(write_text(folder_ / "a.mha", text + std::string(18, 'x')))) << text;
  }
  const std::string flat =
      "ObjectType = Image\nNDims = 2\nDimSize = 2 3\nElementType = MET_UCHAR\nElementSpacing = 0.5 "
      "2\nOffset = 3 4\nTransformMatrix = 0 1 -1 0\nElementDataFile = LOCAL\n";
  EXPECT_TRUE(equals_itk(write_text(folder_ / "a.mha", flat + std::string(6, 'x'))));
}

// NIfTI-1 of 2 x 3 x 3 voxels of 8 bits
class Nifti {
 public:
  explicit Nifti(bool big_endian) : swap_(big_endian), text_(352 + 18, '\0') {
    put<std::int32_t>(0, 348);
    const std::int16_t dims[] = {3, 2, 3, 3, 1, 1, 1, 1};
    for (std::size_t a = 0; a < 8; ++a) put<std::int16_t>(40 + 2 * a, dims[a]);
    put<std::int16_t>(70, 2);
    put<std::int16_t>(72, 8);
    for (std::size_t a = 0; a < 8; ++a) put<float>(76 + 4 * a, 1);
    put<float>(108, 352);
    text_[123] = 2;
    std::memcpy(text_.data() + 344, "n+1", 4);
  }
  template <class T>
  void put(std::size_t at, T value) {
    std::memcpy(text_.data() + at, &value, sizeof value);
    if (swap_) std::reverse(text_.data() + at, text_.data() + at + sizeof value);
  }
  const std::string& text() const { return text_; }

 private:
  bool swap_;
  std::string text_;
};

TEST_F(HeaderGeometry, NiftiWithoutAnSformEqualsItk) {
  for (int round = 0; round < 300; ++round) {
    Nifti nifti(random_() % 2 == 0);
    const bool flat = random_() % 8 == 0;
    if (flat) {
      nifti.put<std::int16_t>(40, 2);
      nifti.put<std::int16_t>(46, 1);
    }
    for (std::size_t a = 0; a < 3; ++a) nifti.put<float>(80 + 4 * a, static_cast<float>(uniform(0.1, 3)));
    const std::int16_t form = flat ? 0 : static_cast<std::int16_t>(random_() % 4);
    nifti.put<std::int16_t>(252, form);
    if (form > 0) {
      nifti.put<float>(76, random_() % 2 ? -1.0f : 1.0f);
      const Eigen::Quaterniond q =
          random_() % 5 == 0
              ? Eigen::Quaterniond(0, uniform(-1, 1), uniform(-1, 1), uniform(-1, 1)).normalized()
              : Eigen::Quaterniond(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1), uniform(-1, 1))
                    .normalized();
      const Eigen::Vector3d vector = random_() % 6 == 0 ? Eigen::Vector3d::Zero() : Eigen::Vector3d(q.vec());
      for (int a = 0; a < 3; ++a) {
        nifti.put<float>(256 + 4 * static_cast<std::size_t>(a), static_cast<float>(vector[a]));
        nifti.put<float>(268 + 4 * static_cast<std::size_t>(a), static_cast<float>(uniform(-200, 200)));
      }
    }
    ASSERT_TRUE(equals_itk(write_text(folder_ / "a.nii", nifti.text())))
        << "round " << round << ", form " << form;
  }
}

TEST(HeaderGeometrySharedData, SharedVolumesEqualItk) {
  for (const char* name :
       {"knee_spl/seg.nrrd", "knee_dess/SAG_3D_DESS_RIGHT_bones_cart_men_fib-label.nrrd",
        "dicom_seg/heart_seg.nrrd", "edge/nrrd_pynrrd/BallBinary30x30x30.nhdr",
        "edge/nrrd_pynrrd/BallBinary30x30x30_gz.nrrd", "edge/nrrd_pynrrd/BallBinary30x30x30.nii.gz",
        "edge/nifti/big.nii.gz", "edge/nifti/little.nii.gz"}) {
    PALPATE_SHARED_FILE(file, name);
    SCOPED_TRACE(name);
    const auto format = format_of(file);
    ASSERT_TRUE(format);
    OtherFiles others;
    const auto data = std::filesystem::path(file).replace_extension(".raw");
    others.add({OtherFile::Which::kNamed, data.filename().string()}, data);
    const auto ours = inspect_file(**format, file, others, {});
    ASSERT_TRUE(ours) << ours.error().message();
    const auto itk = testing::itk_grid_of((*format)->writer, file);
    ASSERT_TRUE(itk);
    const GridGeometry& grid = ours->header.geometry;
    for (int a = 0; a < 3; ++a) {
      const auto n = static_cast<std::size_t>(a);
      EXPECT_EQ(grid.spacing_mm[a], itk->spacing_mm[n]);
      EXPECT_EQ(grid.origin[a], itk->origin_mm[n]);
      for (int r = 0; r < 3; ++r)
        EXPECT_EQ(grid.direction(r, a), itk->columns[n][static_cast<std::size_t>(r)]);
    }
  }
}

}  // namespace
}  // namespace palpate::volume_io
