#pragma once

#include <cstdint>
#include <string>
#include <vector>

/// A viewer of plain sockets, which adds little of its own to what is measured.
namespace palpate::bench {

/// Of the clock by which a server stamps its poses.
std::int64_t steady_ns();

/// What viewers got.
struct PosesSeen {
  std::vector<double> ages_ms;  ///< from a snapshot to the receipt of its message
  std::uint64_t missed = 0;     ///< poses that the server left out, by their sequence
  void add(const PosesSeen& other);
};

class ViewerClient {
 public:
  /// Asks the server on loopback for poses.
  /// @param receive_buffer_bytes  0: the system's
  ViewerClient(int port, double poses_hz, int receive_buffer_bytes = 0, bool task = false);
  ~ViewerClient();
  ViewerClient(const ViewerClient&) = delete;
  ViewerClient& operator=(const ViewerClient&) = delete;

  /// Reads until the time is up or the server is gone.
  void read_until(std::int64_t until_ns);
  const PosesSeen& seen() const { return seen_; }

 private:
  void say(const std::string& bytes);
  bool receive();
  std::string frame();

  int handle_;
  std::string input_;
  PosesSeen seen_;
  std::uint64_t last_ = 0;
};

/// What a viewer loads before it shows anything, the scan and the labels, again and again as one that wants
/// to do harm would.
struct Downloads {
  std::uint64_t bytes = 0, whole = 0;  ///< received; volumes that came to their end
  double first_ms = 0;                 ///< until scan and labels were there for the first time; 0: never
};
/// @return when the time is up or the server is gone
Downloads download_until(int port, std::int64_t until_ns);

/// The value below which a part of them lies; not a number for none. Sorts them.
double quantile(std::vector<double>& values, double part);

}  // namespace palpate::bench
