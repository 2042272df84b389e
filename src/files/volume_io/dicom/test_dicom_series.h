#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <string>
#include <vector>

#include "base/test_files.h"
#include "base/test_folder.h"
#include "palpate/volume_io/volume_io.h"
#include "volume_io/dicom/test_dicom.h"

/// Series written by DCMTK, each with one difficulty, and a fixture that reads them.
namespace palpate::test {

inline constexpr int kSlices = 5;
inline constexpr double kStep_mm = 1.25;

/// Stored value of a voxel, different everywhere, in 12 bits.
inline std::uint16_t stored_at(int i, int j, int k) {
  return static_cast<std::uint16_t>((k * 611 + j * 83 + i * 7) % 4096);
}

/// Stored values of slice k.
inline std::vector<std::uint16_t> words_of(const DicomImage& image, int k) {
  std::vector<std::uint16_t> words;
  for (int j = 0; j < image.rows; ++j)
    for (int i = 0; i < image.columns; ++i) words.push_back(stored_at(i, j, k));
  return words;
}

/// Slice of a series, k steps along the normal of an axial plane.
inline DicomImage slice(int k) {
  DicomImage image;
  image.frames[0].position = {-10, 20, -30 + k * kStep_mm};
  image.frames[0].stored = words_of(image, k);
  return image;
}

inline std::string bytes_of(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// Fixture with a folder of the slices of a series.
class Dicom : public ::testing::Test {
 protected:
  // writes the slices of a series, each modified
  template <class Change>
  void write_series(const Change& change, DicomPacking packing = DicomPacking::kExplicit,
                    int slices = kSlices, const std::string& name = "IM") {
    for (int k = 0; k < slices; ++k) {
      DicomImage image = slice(k);
      change(image, k);
      write_dicom(folder_ / (name + std::to_string(k)), image, packing);
    }
  }
  void write_series(DicomPacking packing = DicomPacking::kExplicit) {
    write_series([](DicomImage&, int) {}, packing);
  }

  Result<ScanFile> read(std::optional<int> volume = {}) {
    return read_scan(
        folder_.path(), {}, [&](const std::string& message) { warnings_ += message + "\n"; },
        VoxelCaching::kOff, volume);
  }
  std::string refusal(std::optional<int> volume = {}) {
    const auto scan = read(volume);
    if (scan) return "no error";
    EXPECT_EQ(scan.error().where, folder_.path().string());
    EXPECT_THAT(scan.error().remedy, ::testing::Not(::testing::IsEmpty()));
    return scan.error().what;
  }
  // compares every voxel with its expected value
  template <class Value>
  void expect_voxels(const Value& value) {
    const auto scan = read();
    ASSERT_TRUE(scan) << scan.error().message();
    const GridGeometry& g = scan->scan.geometry();
    ASSERT_EQ(g.dims, (std::array{8, 6, kSlices}));
    std::size_t wrong = 0;
    for (int k = 0; k < g.dims[2]; ++k)
      for (int j = 0; j < g.dims[1]; ++j)
        for (int i = 0; i < g.dims[0]; ++i)
          wrong += scan->scan.at(i, j, k) != static_cast<float>(value(i, j, k));
    EXPECT_EQ(wrong, 0u);
  }
  void expect_voxels() { expect_voxels(stored_at); }

  const TemporaryFolder folder_;
  std::string warnings_;
};

/// 5 x 7 voxels: 35 bits, so that frames begin at any bit.
inline std::vector<std::uint16_t> mask_of(int seed) {
  std::vector<std::uint16_t> values(35);
  for (int n = 0; n < 35; ++n) values[static_cast<std::size_t>(n)] = (n * n + seed * 7 + n / 3) % 5 < 2;
  return values;
}

}  // namespace palpate::test
