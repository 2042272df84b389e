#include <sys/socket.h>
#include <sys/time.h>

#include <cstdint>
#include <string>

#include "link/test_client.h"
#include "link/test_host.h"

// Bytes as they come from the network, to a whole server: the first byte says whether they are what a new
// connection says or what a welcomed viewer does, and the others come in one or two parts. The server answers
// the next one.
namespace {

using palpate::testing::TestServer;
using palpate::testing::TestSocket;
using palpate::testing::TestViewer;

void say(TestSocket& socket, const std::string& bytes, bool in_two) {
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
    say(socket, bytes, data[0] % 4 == 0);
  } else {
    TestViewer viewer(test->port());
    viewer.greet();
    say(viewer.socket(), bytes, data[0] % 4 == 1);
  }
  return 0;
}
