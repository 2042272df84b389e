#include <cstdlib>

#include "volume_io/mesh/mesh_labels.h"

// the first bytes select the format; a parsed mesh is rasterised
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  using namespace palpate::volume_io;
  if (size == 0) return 0;
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  // format by the first byte of the seeds
  const MeshFormat format = bytes[0] == 'p'                      ? MeshFormat::kPly
                            : bytes[0] == '<'                    ? MeshFormat::kVtkXml
                            : bytes.substr(0, 5) == "# vtk"      ? MeshFormat::kVtkLegacy
                            : bytes[0] == 'v' || bytes[0] == '#' ? MeshFormat::kObj
                                                                 : MeshFormat::kStl;
  const auto file = parse_mesh(bytes, format, "fuzz");
  if (!file) {
    if (file.error().what.empty()) std::abort();
    return 0;
  }
  GridGeometry grid;
  grid.dims = {9, 8, 7};
  grid.origin = Point<Patient>(-4, -4, -3);
  constexpr std::size_t kMaxOnGrid = 2000;
  for (const TriangleMesh& mesh : file->meshes) {
    for (const auto& triangle : mesh.triangles)
      for (const std::uint32_t corner : triangle)
        if (corner >= mesh.points.size()) std::abort();
    if (mesh.triangles.size() > kMaxOnGrid) continue;
    const VoxelRuns voxels = voxels_of_mesh(closed_mesh(mesh), grid, [] { return true; });
    for (int k = -1; k <= grid.dims[2]; ++k)
      voxels.read_slice(k, [&](std::size_t v) {
        if (v >= 9 * 8) std::abort();
      });
  }
  return 0;
}
