#pragma once

#include <cstdint>
#include <string>
#include <vector>

/// A viewer on plain sockets, with little overhead of its own.
namespace palpate::bench {

/// Clock by which a server stamps its poses.
std::int64_t steady_ns();

/// Poses that viewers received.
struct ReceivedPoses {
  std::vector<double> ages_ms;  ///< From a snapshot to the receipt of its message
  std::uint64_t missed = 0;     ///< Poses that the server skipped, by their sequence numbers
  std::uint64_t ticks = 0,
                lost_ticks = 0;  ///< Ticks in bundles; those not received, as the server counts them
  void add(const ReceivedPoses& other);
};

/// Messages that a viewer requests besides poses.
enum class Requested : std::uint8_t { kPoses, kTask, kTicks };

class ViewerClient {
 public:
  /// Connects to the server on loopback and requests poses.
  /// @param receive_buffer_bytes  0: system default
  ViewerClient(int port, double poses_hz, int receive_buffer_bytes = 0,
               Requested requested = Requested::kPoses);
  ~ViewerClient();
  ViewerClient(const ViewerClient&) = delete;
  ViewerClient& operator=(const ViewerClient&) = delete;

  /// Reads until the deadline, or until the server closes the connection.
  void read_until(std::int64_t until_ns);
  const ReceivedPoses& received() const { return received_; }

 private:
  void send(const std::string& bytes);
  bool receive();
  std::string frame();

  int handle_;
  std::string input_;
  ReceivedPoses received_;
  std::uint64_t last_ = 0;
};

/// Downloads of what a viewer loads before it shows anything, scan and labels, repeated continuously as by a
/// malicious one.
struct Downloads {
  std::uint64_t bytes = 0, whole = 0;  ///< Received bytes, and number of complete volumes
  /// Time until scan and labels were complete for the first time; 0: never
  double first_ms = 0;
};
/// @return at the deadline, or when the server closes the connection
Downloads download_until(int port, std::int64_t until_ns);

/// Quantile of the values, which are sorted in place; NaN if there are none.
double quantile(std::vector<double>& values, double part);

}  // namespace palpate::bench
