#include <sys/socket.h>
#include <sys/time.h>

#include <cstdint>
#include <string>

#include "server/test_client.h"
#include "server/test_host.h"

// Bytes from the network, to a complete server: the first byte selects whether a new connection or a welcomed
// viewer sends them, and the rest arrives in one or two parts. The server has to answer the next client.
namespace {

using palpate::testing::TestServer;
using palpate::testing::TestSocket;
using palpate::testing::TestViewer;

void send(TestSocket& socket, const std::string& bytes, bool in_two) {
  const std::size_t first = in_two ? bytes.size() / 2 : bytes.size();
  socket.send(bytes.substr(0, first));
  socket.send(bytes.substr(first));
  socket.end_sending();
  socket.closes();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static TestServer* const test = new TestServer;
  if (size == 0) return 0;
  const std::string bytes(reinterpret_cast<const char*>(data) + 1, size - 1);
  if (data[0] % 2 == 0) {
    TestSocket socket(test->port());
    send(socket, bytes, data[0] % 4 == 0);
  } else {
    TestViewer viewer(test->port());
    viewer.greet();
    send(viewer.socket(), bytes, data[0] % 4 == 1);
  }
  return 0;
}
