// The simulated brick's USB end against a client written from the protocol's text: bytes here are
// not taken from the server.

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <random>

#include "protocol/base/mutex.h"
#include "simulator/bridge/usbip_server.h"

namespace mesorig::simulator {
namespace {

std::string Bytes(std::initializer_list<int> values) {
  std::string out;
  for (const int value : values) out.push_back(static_cast<char>(value));
  return out;
}

std::string Big32(uint32_t value) {
  return Bytes({static_cast<int>(value >> 24), static_cast<int>(value >> 16 & 255),
                static_cast<int>(value >> 8 & 255), static_cast<int>(value & 255)});
}

const std::string kDeviceList = Bytes({0x01, 0x11, 0x80, 0x05, 0, 0, 0, 0});
const std::string kImport = Bytes({0x01, 0x11, 0x80, 0x03, 0, 0, 0, 0});

std::string BusId(std::string id) {
  id.resize(32, '\0');
  return id;
}

std::string Submit(uint32_t number, bool in, uint32_t endpoint, uint32_t size,
                   const std::string& setup = std::string(8, '\0')) {
  return Big32(1) + Big32(number) + Big32(0x10002) + Big32(in ? 1 : 0) + Big32(endpoint) +
         Big32(0) + Big32(size) + Big32(0) + Big32(0) + Big32(0) + setup;
}

std::string Unlink(uint32_t number, uint32_t other) {
  return Big32(2) + Big32(number) + Big32(0x10002) + Big32(0) + Big32(0) + Big32(other) +
         std::string(24, '\0');
}

uint32_t At(const std::string& bytes, size_t at) {
  uint32_t value = 0;
  for (size_t k = 0; k < 4; ++k) value = value << 8 | static_cast<uint8_t>(bytes.at(at + k));
  return value;
}

class UsbipTest : public ::testing::Test {
 protected:
  UsbipTest() {
    auto server = UsbipServer::Open(0, "0016530A1B2C", [this](std::string packet) {
      MutexLock lock(mutex_);
      packets_.push_back(std::move(packet));
    });
    EXPECT_TRUE(server.ok()) << server.status();
    if (server.ok()) server_ = *std::move(server);
    Connect();
  }
  ~UsbipTest() override { ::close(client_); }
  void Connect() {
    ::close(client_);
    client_ = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(static_cast<uint16_t>(server_->port()));
    EXPECT_EQ(::connect(client_, reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
  }
  void Say(const std::string& bytes) {
    EXPECT_EQ(::send(client_, bytes.data(), bytes.size(), MSG_NOSIGNAL),
              static_cast<ssize_t>(bytes.size()));
  }
  // What comes, up to `size`; shorter when the server closes.
  std::string Hear(size_t size) {
    std::string bytes(size, '\0');
    size_t done = 0;
    while (done < size) {
      pollfd ready{client_, POLLIN, 0};
      if (::poll(&ready, 1, 20000) <= 0) break;
      const ssize_t got = ::recv(client_, bytes.data() + done, size - done, 0);
      if (got <= 0) break;
      done += static_cast<size_t>(got);
    }
    bytes.resize(done);
    return bytes;
  }
  void Attach() {
    Say(kImport + BusId("1-1"));
    const std::string reply = Hear(320);
    ASSERT_EQ(reply.size(), 320u);
    ASSERT_EQ(reply.substr(0, 8), Bytes({0x01, 0x11, 0, 3, 0, 0, 0, 0}));
  }
  // Status and data of the reply to this URB.
  std::pair<int32_t, std::string> Result(uint32_t number, bool in) {
    const std::string header = Hear(48);
    if (header.size() != 48) return {1, "no reply"};
    EXPECT_EQ(At(header, 0), 3u);
    EXPECT_EQ(At(header, 4), number);
    return {static_cast<int32_t>(At(header, 20)), in ? Hear(At(header, 24)) : ""};
  }
  std::pair<int32_t, std::string> GetDescriptor(int type, int index, int size) {
    const std::string setup = Bytes({0x80, 6, index, type, 0, 0, size & 255, size >> 8});
    Say(Submit(9, true, 0, static_cast<uint32_t>(size), setup));
    return Result(9, true);
  }
  std::vector<std::string> packets() {
    MutexLock lock(mutex_);
    return packets_;
  }

  Mutex mutex_;
  std::vector<std::string> packets_ GUARDED_BY(mutex_);
  std::unique_ptr<UsbipServer> server_;
  int client_ = -1;
};

TEST_F(UsbipTest, ListsOneBrickAndGivesItToWhoKnowsItsPlace) {
  Say(kDeviceList);
  const std::string list = Hear(8 + 4 + 312 + 4);
  ASSERT_EQ(list.size(), 328u);
  EXPECT_EQ(At(list, 8), 1u);
  EXPECT_EQ(list.substr(12 + 256, 32), BusId("1-1"));
  EXPECT_EQ(list.substr(12 + 256 + 32 + 8, 8), Bytes({0, 0, 0, 2, 0x06, 0x94, 0x00, 0x02}));
  EXPECT_EQ(list.substr(324), Bytes({0xFF, 0, 0, 0}));
  EXPECT_EQ(Hear(1), "") << "one request a connection";
  Connect();
  Say(kImport + BusId("7-9"));
  EXPECT_EQ(Hear(400), Bytes({0x01, 0x11, 0, 3, 0, 0, 0, 1}));
  Connect();
  Attach();
}

TEST_F(UsbipTest, DescribesItselfAsTheManualSays) {
  ASSERT_NO_FATAL_FAILURE(Attach());
  const auto device = GetDescriptor(1, 0, 18);
  EXPECT_EQ(device.first, 0);
  EXPECT_EQ(device.second, Bytes({18, 1, 0, 2, 0, 0, 0, 64, 0x94, 0x06, 2, 0, 0, 0, 0, 0, 1, 1}));
  EXPECT_EQ(GetDescriptor(1, 0, 8).second.size(), 8u) << "no more than was asked for";
  const std::string configuration = GetDescriptor(2, 0, 255).second;
  ASSERT_EQ(configuration.size(), 32u);
  EXPECT_EQ(configuration.substr(18), Bytes({7, 5, 0x01, 2, 64, 0, 0, 7, 5, 0x82, 2, 64, 0, 0}));
  const std::string serial = GetDescriptor(3, 1, 255).second;
  EXPECT_EQ(serial.substr(0, 6), std::string("\x1A\x03"
                                             "0\0"
                                             "0\0",
                                             6));
  EXPECT_EQ(serial.size(), 26u);
  EXPECT_EQ(GetDescriptor(3, 2, 255).first, -EPIPE) << "there is no such string";
  Say(Submit(3, false, 0, 0, Bytes({0, 9, 1, 0, 0, 0, 0, 0})));  // set configuration 1
  EXPECT_EQ(Result(3, false).first, 0);
  Say(Submit(4, true, 0, 1, Bytes({0x80, 8, 0, 0, 0, 0, 1, 0})));
  EXPECT_EQ(Result(4, true).second, Bytes({1}));
}

TEST_F(UsbipTest, CarriesPacketsBothWays) {
  ASSERT_NO_FATAL_FAILURE(Attach());
  Say(Submit(1, false, 1, 2) + Bytes({0, 0x0D}));
  EXPECT_EQ(Result(1, false).first, 0);
  Say(Submit(2, false, 1, 70) + std::string(70, 'x'));
  EXPECT_EQ(Result(2, false).first, 0);
  EXPECT_EQ(packets(), (std::vector<std::string>{Bytes({0, 0x0D}), std::string(64, 'x'),
                                                 std::string(6, 'x')}));
  Say(Submit(3, true, 2, 64));  // asked for before it is there
  Say(Submit(4, false, 1, 1) + "y");
  EXPECT_EQ(Result(4, false).first, 0) << "an idle IN holds nothing up";
  server_->Deliver("reply");
  EXPECT_EQ(Result(3, true), std::make_pair(0, std::string("reply")));
  server_->Deliver("waits");
  Say(Submit(5, true, 2, 64));
  EXPECT_EQ(Result(5, true).second, "waits");
  server_->Deliver("too long");
  Say(Submit(6, true, 2, 3));
  EXPECT_EQ(Result(6, true).first, -EOVERFLOW);
  Say(Submit(7, true, 5, 3));
  EXPECT_EQ(Result(7, true).first, -EPIPE) << "there is no such endpoint";
}

TEST_F(UsbipTest, AnIdleInIsTakenBack) {
  ASSERT_NO_FATAL_FAILURE(Attach());
  Say(Submit(1, true, 2, 64) + Unlink(2, 1) + Unlink(3, 1));
  const std::string first = Hear(48), second = Hear(48);
  EXPECT_EQ(At(first, 0), 4u);
  EXPECT_EQ(static_cast<int32_t>(At(first, 20)), -ECONNRESET);
  EXPECT_EQ(At(second, 20), 0u) << "it was gone already";
  server_->Deliver("later");
  Say(Submit(4, true, 2, 64));
  EXPECT_EQ(Result(4, true).second, "later") << "the packet was not lost with it";
}

TEST_F(UsbipTest, WhatWaitsIsBoundedAndGoesWithTheClient) {
  ASSERT_NO_FATAL_FAILURE(Attach());
  for (int i = 0; i < 100; ++i) server_->Deliver(std::to_string(i));
  Say(Submit(1, true, 2, 64));
  EXPECT_EQ(Result(1, true).second, "84") << "sixteen are kept";
  Connect();
  ASSERT_NO_FATAL_FAILURE(Attach());
  server_->Deliver("new");
  Say(Submit(2, true, 2, 64));
  EXPECT_EQ(Result(2, true).second, "new");
}

// Any bytes: an answer or the end of the connection, and the next client is served.
TEST_F(UsbipTest, WhatIsWrongEndsTheConnectionOnly) {
  std::mt19937 random(7);
  const std::string good[] = {kDeviceList, kImport + BusId("1-1"),
                              kImport + BusId("1-1") + Submit(1, false, 1, 2) + "ab" +
                                  Submit(2, true, 2, 64) + Unlink(3, 2)};
  for (int round = 0; round < 200; ++round) {
    std::string bytes = good[random() % 3];
    for (int k = 0; k < 3; ++k) bytes[random() % bytes.size()] = static_cast<char>(random());
    bytes.resize(random() % bytes.size());
    Say(bytes);
    ::shutdown(client_, SHUT_WR);
    (void)Hear(1 << 16);  // until the server closes
    Connect();
  }
  ASSERT_NO_FATAL_FAILURE(Attach());
  EXPECT_EQ(GetDescriptor(1, 0, 18).second.size(), 18u);
  Say(Submit(1, true, 2, 0x7FFFFFFF));
  EXPECT_EQ(Hear(1), "") << "a URB of 2 GB";
}

TEST(UsbipMessages, RefuseWhatIsNotTheirs) {
  using usbip::ParseRequest;
  using usbip::ParseUrb;
  EXPECT_TRUE(ParseRequest(kDeviceList).ok());
  for (const std::string& bytes :
       {std::string(), kDeviceList.substr(1), kDeviceList + "x",
        Bytes({0x01, 0x06, 0x80, 0x05, 0, 0, 0, 0}), Bytes({0x01, 0x11, 0x80, 0x04, 0, 0, 0, 0})}) {
    EXPECT_TRUE(absl::IsInvalidArgument(ParseRequest(bytes).status()));
  }
  EXPECT_TRUE(ParseUrb(Submit(1, true, 2, 65536)).ok());
  for (const uint32_t size : {65537u, 0x80000000u, 0xFFFFFFFFu}) {
    EXPECT_TRUE(absl::IsInvalidArgument(ParseUrb(Submit(1, true, 2, size)).status())) << size;
  }
  std::string other = Submit(1, true, 2, 1);
  other[3] = 3;  // a reply
  EXPECT_TRUE(absl::IsInvalidArgument(ParseUrb(other).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(ParseUrb(other.substr(1)).status()));
}

}  // namespace
}  // namespace mesorig::simulator
