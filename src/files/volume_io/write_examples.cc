#include <cstdio>
#include <filesystem>
#include <string>

#include "palpate/volume_io/write_volume.h"
#include "volume/test_grids.h"

/// Writes some unusual volumes into the given folder, to be read by other software in reopen_check.py, and
/// prints the intended geometry: "file dims origin columns", columns scaled by the spacing, LPS mm.
int main(int argc, char** argv) {
  if (argc != 2) return 2;
  const std::filesystem::path folder = argv[1];
  int number = 0;
  for (const palpate::GridGeometry& g : palpate::testing::awkward_grids({5, 4, 3})) {
    palpate::Volume<std::int16_t> volume(g);
    for (std::size_t n = 0; n < volume.voxels().size(); ++n)
      volume.voxels()[n] = static_cast<std::int16_t>(static_cast<int>(n) * 7 - 100);
    const bool square = (g.direction.transpose() * g.direction).isIdentity(1e-9);
    for (const char* ending : {".nrrd", ".nii.gz", ".nii", ".mha"}) {
      // NIfTI as written by ITK supports only orthogonal axes
      const std::string name = "grid" + std::to_string(number) + ending;
      const auto written = palpate::write_volume(folder / name, volume);
      if (!square && name.find(".nii") != std::string::npos) {
        if (written) return 3;
        continue;
      }
      if (!written) {
        std::fprintf(stderr, "%s\n", written.error().message().c_str());
        return 1;
      }
      std::printf("%s %d %d %d", name.c_str(), g.dims[0], g.dims[1], g.dims[2]);
      for (int r = 0; r < 3; ++r) std::printf(" %.17g", g.origin[r]);
      for (int c = 0; c < 3; ++c)
        for (int r = 0; r < 3; ++r) std::printf(" %.17g", g.X_PatientVoxel().linear()(r, c));
      std::printf("\n");
    }
    ++number;
  }
}
