#include "surfaces/surface_net_links.h"

namespace palpate::internal {

namespace {

/// Corner masks of a cell's faces, in the order of NetLinks::to.
constexpr std::array<unsigned, 6> kFaceCorners{0x55, 0xaa, 0x33, 0xcc, 0x0f, 0xf0};

}  // namespace

NetLinks::NetLinks(const SurfaceNet& net) : NetLinks(net.size()) {
  for_each_row(net.cells, [&](int j, int k) {
    const int from = net.cells.low[0];
    std::array<RowOfNodes, 6> rows{RowOfNodes(net, j, k, from),     RowOfNodes(net, j, k, from),
                                   RowOfNodes(net, j - 1, k, from), RowOfNodes(net, j + 1, k, from),
                                   RowOfNodes(net, j, k - 1, from), RowOfNodes(net, j, k + 1, from)};
    const std::size_t r = net.row(j, k);
    for (std::uint32_t n = net.row_begin[r]; n < net.row_begin[r + 1]; ++n) {
      float links = 0;
      CellPosition sum = CellPosition::Zero();
      for (int f = 0; f < 6; ++f) {
        to[n][f] = n;
        const unsigned face = net.classes[n] & kFaceCorners[f];
        if (face == 0 || face == kFaceCorners[f]) continue;
        const int step = f % 2 == 0 ? -1 : 1;
        const std::uint32_t m = rows[f].find(net.column[n] + (f < 2 ? step : 0));
        if (m == SurfaceNet::kNone) continue;
        to[n][f] = m;
        sum[f / 2] += static_cast<float>(step);
        ++links;
      }
      fraction[n] = links > 0 ? 1 / links : 0;
      offset[n] = sum * fraction[n];
    }
  });
}

void carve_net(const SurfaceNet& original, SurfaceNet& now) {
  std::vector<std::uint32_t> cut;
  for_each_row(now.cells, [&](int j, int k) {
    const std::size_t r = now.row(j, k);
    RowOfNodes row(original, j, k, now.cells.low[0]);
    for (std::uint32_t n = now.row_begin[r]; n < now.row_begin[r + 1]; ++n) {
      const std::uint32_t before = row.find(now.column[n]);
      if (before != SurfaceNet::kNone && original.classes[before] == now.classes[n])
        now.positions[n] = original.positions[before];
      else
        cut.push_back(n);
    }
  });
  if (cut.empty()) return;
  const NetLinks links(now);
  std::vector<CellPosition> moved(cut.size());
  for (int round = 0; round < kCarvingRounds; ++round) {
    for (std::size_t c = 0; c < cut.size(); ++c) {
      const std::uint32_t n = cut[c];
      const CellPosition displacement =
          links.difference_sum(now.positions, n) * links.fraction[n] + links.offset[n];
      moved[c] = (now.positions[n] + displacement).max(kCellMargin).min(1 - kCellMargin);
    }
    for (std::size_t c = 0; c < cut.size(); ++c) now.positions[cut[c]] = moved[c];
  }
}

}  // namespace palpate::internal
