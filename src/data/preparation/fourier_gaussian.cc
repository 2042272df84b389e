#include "preparation/fourier_gaussian.h"

#include <kiss_fftr.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <new>
#include <numbers>

// A real volume of nx x ny x nz voxels is padded to px x py x pz (products of 2, 3 and 5):
//
//   1  slice by slice: transform along i (real to px/2+1 complex numbers) and along j
//   2  for each row of frequencies: transform along k, multiply by the response, inverse transform
//   3  slice by slice: inverse transform along j and i, round
//
// Padding is not stored where it is not needed: along k it exists only within step 2, so that the
// intermediate spectrum has (px/2+1) * py * nz complex numbers.
namespace palpate::internal {

namespace {

constexpr double kPadSigmas = 5;

struct FreePlan {
  void operator()(void* plan) const { kiss_fft_free(plan); }
};
using ComplexPlan = std::unique_ptr<kiss_fft_state, FreePlan>;
using RealPlan = std::unique_ptr<kiss_fftr_state, FreePlan>;

ComplexPlan complex_plan(int n, bool inverse) {
  ComplexPlan plan(kiss_fft_alloc(n, inverse ? 1 : 0, nullptr, nullptr));
  if (plan == nullptr) throw std::bad_alloc();
  return plan;
}
RealPlan real_plan(int n, bool inverse) {
  RealPlan plan(kiss_fftr_alloc(n, inverse ? 1 : 0, nullptr, nullptr));
  if (plan == nullptr) throw std::bad_alloc();
  return plan;
}

/// Complex transforms along a strided axis. Adjacent columns are transformed together, because a cache line
/// holds eight complex numbers.
class Columns {
 public:
  static constexpr int kTogether = 8;

  explicit Columns(int length)
      : length_(length),
        forward_(complex_plan(length, false)),
        inverse_(complex_plan(length, true)),
        gathered_(static_cast<std::size_t>(kTogether) * length),
        transformed_(gathered_.size()) {}

  /// Transforms every column, of which only the first `rows` numbers are non-zero, in place; the first
  /// `rows_out` numbers of the result are stored.
  void forward(kiss_fft_cpx* data, std::size_t stride, int columns, int rows, int rows_out) {
    transform_columns(forward_.get(), data, stride, columns, rows, rows_out);
  }
  void inverse(kiss_fft_cpx* data, std::size_t stride, int columns, int rows, int rows_out) {
    transform_columns(inverse_.get(), data, stride, columns, rows, rows_out);
  }
  /// Forward transform; column c times column_factor[c] * factor * response; inverse transform.
  void filter(kiss_fft_cpx* data, std::size_t stride, int columns, int rows,
              const std::vector<float>& response, const std::vector<float>& column_factor, float factor) {
    for_blocks(columns, [&](int first, int count) {
      gather(data + first, stride, count, rows);
      transform(forward_.get(), count);
      for (int c = 0; c < count; ++c) {
        const float scale = column_factor[first + c] * factor;
        kiss_fft_cpx* column = transformed_.data() + static_cast<std::size_t>(c) * length_;
        for (int n = 0; n < length_; ++n) {
          column[n].r *= response[n] * scale;
          column[n].i *= response[n] * scale;
        }
      }
      std::swap(gathered_, transformed_);
      transform(inverse_.get(), count);
      scatter(data + first, stride, count, rows);
    });
  }

 private:
  void transform_columns(kiss_fft_state* plan, kiss_fft_cpx* data, std::size_t stride, int columns, int rows,
                         int rows_out) {
    for_blocks(columns, [&](int first, int count) {
      gather(data + first, stride, count, rows);
      transform(plan, count);
      scatter(data + first, stride, count, rows_out);
    });
  }
  template <class Work>
  static void for_blocks(int columns, const Work& work) {
    for (int first = 0; first < columns; first += kTogether)
      work(first, std::min(kTogether, columns - first));
  }
  void gather(const kiss_fft_cpx* data, std::size_t stride, int count, int rows) {
    std::fill(gathered_.begin(), gathered_.end(), kiss_fft_cpx{0, 0});
    for (int n = 0; n < rows; ++n) {
      for (int c = 0; c < count; ++c)
        gathered_[static_cast<std::size_t>(c) * length_ + n] = data[n * stride + c];
    }
  }
  void transform(kiss_fft_state* plan, int count) {
    for (int c = 0; c < count; ++c) {
      const std::size_t at = static_cast<std::size_t>(c) * length_;
      kiss_fft(plan, gathered_.data() + at, transformed_.data() + at);
    }
  }
  void scatter(kiss_fft_cpx* data, std::size_t stride, int count, int rows) const {
    for (int n = 0; n < rows; ++n) {
      for (int c = 0; c < count; ++c)
        data[n * stride + c] = transformed_[static_cast<std::size_t>(c) * length_ + n];
    }
  }

  int length_;
  ComplexPlan forward_, inverse_;
  std::vector<kiss_fft_cpx> gathered_, transformed_;
};

/// Buffers and plans of one worker. KissFFT's real plans contain scratch memory and cannot be shared.
struct Worker {
  Worker(int px, int py, int pz)
      : along_i(real_plan(px, false)),
        back_along_i(real_plan(px, true)),
        along_j(py),
        along_k(pz),
        line(px) {}
  RealPlan along_i, back_along_i;
  Columns along_j, along_k;
  std::vector<float> line;
};

void put(float value, float& out) {
  out = value;
}
void put(float value, std::uint8_t& out) {
  out = static_cast<std::uint8_t>(std::lrint(std::clamp(value, 0.0f, 255.0f)));
}
void put(float value, std::uint16_t& out) {
  out = static_cast<std::uint16_t>(std::lrint(std::clamp(257 * value, 0.0f, 65535.0f)));
}

/// The three steps, each for one slice or row of the padded half spectrum.
template <class In, class Out>
class FourierSmoother {
 public:
  FourierSmoother(const Volume<In>& volume, const std::array<double, 3>& sigma, int threads)
      : volume_(volume),
        dims_(volume.geometry().dims),
        px_(kiss_fftr_next_fast_size_real(padded(dims_[0], sigma[0]))),
        py_(kiss_fft_next_fast_size(padded(dims_[1], sigma[1]))),
        pz_(kiss_fft_next_fast_size(padded(dims_[2], sigma[2]))),
        response_i_(gaussian_response(sigma[0], px_)),
        response_j_(gaussian_response(sigma[1], py_)),
        response_k_(gaussian_response(sigma[2], pz_)),
        spectrum_(slice_size() * dims_[2]),
        smooth_(volume.geometry()) {
    const int count = worker_count(threads, std::max(dims_[2], py_));
    for (int n = 0; n < count; ++n) workers_.emplace_back(px_, py_, pz_);
  }

  Result<Volume<Out>> run(const Progress& progress, const ProgressSpan& span) {
    const auto step = [&](int count, double from, double to, auto work) {
      return for_each_slice(count, worker_count(static_cast<int>(workers_.size()), count), progress,
                            span.part(from, to), [&](int w, int n) { (this->*work)(workers_[w], n); });
    };
    if (auto done = step(dims_[2], 0, 0.3, &FourierSmoother::transform_slice); !done) return done.error();
    if (auto done = step(py_, 0.3, 0.7, &FourierSmoother::filter_row); !done) return done.error();
    if (auto done = step(dims_[2], 0.7, 1, &FourierSmoother::restore_slice); !done) return done.error();
    return std::move(smooth_);
  }

 private:
  static int padded(int n, double sigma) { return n + static_cast<int>(std::ceil(kPadSigmas * sigma)); }
  int frequencies_i() const { return px_ / 2 + 1; }
  std::size_t slice_size() const { return static_cast<std::size_t>(frequencies_i()) * py_; }

  void transform_slice(Worker& worker, int k) {
    kiss_fft_cpx* slice = spectrum_.data() + k * slice_size();
    std::fill(worker.line.begin(), worker.line.end(), 0.0f);
    for (int j = 0; j < dims_[1]; ++j) {
      const In* row = volume_.voxels().data() + volume_.geometry().offset(0, j, k);
      std::copy_n(row, dims_[0], worker.line.begin());
      kiss_fftr(worker.along_i.get(), worker.line.data(),
                slice + static_cast<std::size_t>(j) * frequencies_i());
    }
    worker.along_j.forward(slice, frequencies_i(), frequencies_i(), dims_[1], py_);
  }

  void filter_row(Worker& worker, int j) {
    // KissFFT's inverse transform is unscaled
    const double voxels = static_cast<double>(px_) * py_ * pz_;
    worker.along_k.filter(spectrum_.data() + static_cast<std::size_t>(j) * frequencies_i(), slice_size(),
                          frequencies_i(), dims_[2], response_k_, response_i_,
                          static_cast<float>(response_j_[j] / voxels));
  }

  void restore_slice(Worker& worker, int k) {
    kiss_fft_cpx* slice = spectrum_.data() + k * slice_size();
    worker.along_j.inverse(slice, frequencies_i(), frequencies_i(), py_, dims_[1]);
    for (int j = 0; j < dims_[1]; ++j) {
      kiss_fftri(worker.back_along_i.get(), slice + static_cast<std::size_t>(j) * frequencies_i(),
                 worker.line.data());
      Out* row = smooth_.voxels().data() + smooth_.geometry().offset(0, j, k);
      for (int i = 0; i < dims_[0]; ++i) put(worker.line[i], row[i]);
    }
  }

  const Volume<In>& volume_;
  std::array<int, 3> dims_;
  int px_, py_, pz_;
  std::vector<float> response_i_, response_j_, response_k_;
  std::vector<kiss_fft_cpx> spectrum_;
  Volume<Out> smooth_;
  std::vector<Worker> workers_;
};

}  // namespace

std::vector<float> gaussian_response(double sigma_voxels, int n) {
  std::vector<float> response(n);
  for (int m = 0; m < n; ++m) {
    const double nu = static_cast<double>(m <= n / 2 ? m : m - n) / n;
    const double x = std::numbers::pi * sigma_voxels * nu;
    response[m] = static_cast<float>(std::exp(-2 * x * x));
  }
  return response;
}

template <class In, class Out>
Result<Volume<Out>> smooth_fourier(const Volume<In>& volume, const std::array<double, 3>& sigma_voxels,
                                   int threads, const Progress& progress, const ProgressSpan& span) {
  if (volume.empty()) return Volume<Out>(volume.geometry());
  return FourierSmoother<In, Out>(volume, sigma_voxels, threads).run(progress, span);
}

template Result<Volume<std::uint8_t>> smooth_fourier(const Volume<std::uint8_t>&,
                                                     const std::array<double, 3>&, int, const Progress&,
                                                     const ProgressSpan&);
template Result<Volume<std::uint16_t>> smooth_fourier(const Volume<std::uint8_t>&,
                                                      const std::array<double, 3>&, int, const Progress&,
                                                      const ProgressSpan&);
template Result<Volume<float>> smooth_fourier(const Volume<std::uint8_t>&, const std::array<double, 3>&, int,
                                              const Progress&, const ProgressSpan&);
template Result<Volume<float>> smooth_fourier(const Volume<float>&, const std::array<double, 3>&, int,
                                              const Progress&, const ProgressSpan&);

}  // namespace palpate::internal
