#pragma once

#include <cstddef>

namespace palpate {

/// Processor time of the calling thread.
double tissue_thread_seconds();

/// What a frame of soft tissue costs this machine, in processor time of one thread.
struct TissueFrame {
  std::size_t cells = 0;   ///< that yield
  double frame_ms = 0;     ///< median of the frames
  double off_percent = 0;  ///< of the compliance under the tool from the converged one, at worst
  double kernel_ns = 0;    ///< K u, a cell, the fastest of all
  double floor_ns = 0;     ///< a plain loop that reads and writes as many bytes, a cell, the fastest of all
};

/// A sphere slides over 39 105 cells of layered tissue on one layer of bone at 20 mm/s, 60 times a second; in
/// each frame two iterations from the last solution.
TissueFrame measure_tissue_frame(int frames);

}  // namespace palpate
