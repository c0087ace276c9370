#include "server/session/resume_token.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <set>
#include <string>

#include "absl/strings/str_cat.h"
#include "candela/v1/render.pb.h"
#include "proto/candela/v1/limits.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

const absl::Time kNow = absl::FromUnixSeconds(1'700'000'000);
constexpr absl::Duration kTtl = absl::Seconds(90);

std::string key(char digit) { return std::string(64, digit); }

TokenKeys keys(const std::string& lines) {
  const TemporaryFile file(lines);
  absl::StatusOr<TokenKeys> read = TokenKeys::read(file.path(), kTtl);
  EXPECT_OK(read);
  return *std::move(read);
}

// Every field has a value other than its default, and its greatest length.
ResumePoint full_point() {
  ResumePoint point{.session = std::string(v1::kMaxSessionNameBytes, 's'),
                    .epoch = ~uint64_t{0},
                    .sequence = ~uint64_t{0} - 1,
                    .exposure = {.begun = true,
                                 .sequence = ~uint64_t{0} - 2,
                                 .media_time_ns = v1::kMediaTimeNs.max,
                                 .exposed = {1.0 / 3.0, 0x1.fffffffffffffp39},
                                 .before = 0x1p-40,
                                 .cut = true,
                                 .cut_pending = true,
                                 .print = ScenePrint()},
                    .settings_hash = settings_hash(v1::Settings())};
  for (size_t i = 0; i < point.exposure.print->size(); ++i) {
    (*point.exposure.print)[i] = -17.3f + static_cast<float>(i) / 7.0f;
  }
  return point;
}

void expect_equal(const ResumePoint& a, const ResumePoint& b) {
  EXPECT_EQ(a.session, b.session);
  EXPECT_EQ(a.epoch, b.epoch);
  EXPECT_EQ(a.sequence, b.sequence);
  EXPECT_EQ(a.exposure, b.exposure);
  EXPECT_EQ(a.settings_hash, b.settings_hash);
}

// The refusal's message; empty if there was none.
std::string refusal(const TokenKeys& by, const std::string& token, const std::string& session,
                    absl::Time now = kNow) {
  const absl::Status status = by.open(token, session, now).status();
  if (status.ok()) return "";
  EXPECT_REFUSED(kFailedPrecondition, "", status);
  return std::string(status.message());
}

TEST(ResumeToken, GivesBackWhatItWasMadeOfInAtMostAKibibyte) {
  const TokenKeys ours = keys(key('a'));
  const ResumePoint full = full_point();
  const std::string token = ours.seal(full, kNow);
  EXPECT_LE(token.size(), v1::kMaxTokenBytes);
  ASSERT_OK_AND_ASSIGN(const ResumePoint opened, ours.open(token, full.session, kNow));
  expect_equal(opened, full);

  const ResumePoint first{.session = "s", .exposure = {}, .settings_hash = ""};
  ASSERT_OK_AND_ASSIGN(const ResumePoint begun, ours.open(ours.seal(first, kNow), "s", kNow));
  expect_equal(begun, first);
  EXPECT_FALSE(begun.exposure.print);
}

// A cell without weight is NaN, and a resumed session must see the same NaN.
TEST(ResumeToken, APrintComesBackBitForBit) {
  const TokenKeys ours = keys(key('a'));
  ResumePoint point = full_point();
  ScenePrint& print = *point.exposure.print;
  print[0] = NAN;
  print[1] = -0.0f;
  print[2] = std::bit_cast<float>(0x7fc12345u);
  print[3] = 0x1p-149f;
  ASSERT_OK_AND_ASSIGN(const ResumePoint opened, ours.open(ours.seal(point, kNow), point.session, kNow));
  for (size_t i = 0; i < print.size(); ++i) {
    EXPECT_EQ(std::bit_cast<uint32_t>((*opened.exposure.print)[i]), std::bit_cast<uint32_t>(print[i])) << i;
  }
}

TEST(ResumeToken, AnyBitThatChangedIsRefused) {
  const TokenKeys ours = keys(key('a'));
  const ResumePoint point = full_point();
  const std::string token = ours.seal(point, kNow);
  for (size_t bit = 0; bit < token.size() * 8; ++bit) {
    std::string forged = token;
    forged[bit / 8] = static_cast<char>(forged[bit / 8] ^ (1 << bit % 8));
    EXPECT_NE(refusal(ours, forged, point.session), "") << "bit " << bit;
  }
  std::string forged = token;
  forged.back() = static_cast<char>(forged.back() ^ 1);
  EXPECT_TRUE(says(refusal(ours, forged, point.session), "changed after it was signed"));
}

TEST(ResumeToken, ATokenOfAnyOtherLengthIsRefused) {
  const TokenKeys ours = keys(key('a'));
  const ResumePoint point = full_point();
  const std::string token = ours.seal(point, kNow);
  for (size_t length = 0; length < token.size(); ++length) {
    EXPECT_TRUE(says(refusal(ours, token.substr(0, length), point.session), "cut short")) << length;
  }
  EXPECT_TRUE(says(refusal(ours, token + '\0', point.session), "behind its end"));
  const std::string longest = token + std::string(v1::kMaxTokenBytes - token.size(), '\0');
  EXPECT_TRUE(says(refusal(ours, longest, point.session), "behind its end"));
  EXPECT_TRUE(says(refusal(ours, longest + '\0', point.session), "at most 1024"));
}

TEST(ResumeToken, ATokenOfAnotherVersionIsRefused) {
  const TokenKeys ours = keys(key('a'));
  std::string token = ours.seal(full_point(), kNow);
  token[0] = 2;
  EXPECT_TRUE(says(refusal(ours, token, full_point().session), "version"));
}

TEST(ResumeToken, AForeignKeysTokenIsRefused) {
  const ResumePoint point = full_point();
  const TokenKeys theirs = keys(key('b'));
  EXPECT_TRUE(says(refusal(keys(key('a')), theirs.seal(point, kNow), point.session), "key that this server"));
  ASSERT_OK_AND_ASSIGN(const TokenKeys one, TokenKeys::random());
  ASSERT_OK_AND_ASSIGN(const TokenKeys other, TokenKeys::random());
  EXPECT_EQ(refusal(one, one.seal(point, kNow), point.session), "");
  EXPECT_TRUE(says(refusal(other, one.seal(point, kNow), point.session), "key that this server"));
}

// A token with the right key's id and another key's signature.
TEST(ResumeToken, AKnownKeysNameAloneOpensNothing) {
  const TokenKeys ours = keys(key('a'));
  const ResumePoint point = full_point();
  std::string forged = keys(key('b')).seal(point, kNow);
  forged.replace(1, 8, ours.seal(point, kNow), 1, 8);
  EXPECT_TRUE(says(refusal(ours, forged, point.session), "changed after it was signed"));
}

TEST(ResumeToken, KeysRotate) {
  const ResumePoint point = full_point();
  const TokenKeys before = keys(key('a'));
  const TokenKeys added = keys(key('a') + "\n" + key('b'));
  const TokenKeys moved = keys(key('b') + "\n" + key('a'));
  const TokenKeys after = keys(key('b'));
  EXPECT_EQ(added.seal(point, kNow), before.seal(point, kNow)) << "the first key signs";
  EXPECT_EQ(moved.seal(point, kNow), after.seal(point, kNow)) << "the first key signs";
  for (const TokenKeys* server : {&added, &moved}) {
    EXPECT_EQ(refusal(*server, before.seal(point, kNow), point.session), "");
    EXPECT_EQ(refusal(*server, after.seal(point, kNow), point.session), "");
  }
  EXPECT_TRUE(says(refusal(after, before.seal(point, kNow), point.session), "key that this server"));
}

TEST(ResumeToken, IsGoodUntilItsTimeAndNoLonger) {
  const TokenKeys ours = keys(key('a'));
  const ResumePoint point = full_point();
  const std::string token = ours.seal(point, kNow);
  EXPECT_EQ(refusal(ours, token, point.session, kNow + kTtl - absl::Nanoseconds(1)), "");
  EXPECT_TRUE(says(refusal(ours, token, point.session, kNow + kTtl), "expired 0 ago"));
  EXPECT_TRUE(says(refusal(ours, token, point.session, kNow + kTtl + absl::Seconds(5)), "expired 5s ago"));
}

TEST(ResumeToken, AnotherSessionsTokenIsRefused) {
  const TokenKeys ours = keys(key('a'));
  const ResumePoint point = full_point();
  EXPECT_TRUE(says(refusal(ours, ours.seal(point, kNow), "other"), "another session than \"other\""));
  EXPECT_TRUE(says(refusal(ours, ours.seal(point, kNow), ""), "another session"));
}

// Each refusal tells a client what to do.
TEST(ResumeToken, EachRefusalHasItsOwnWords) {
  const TokenKeys ours = keys(key('a'));
  const ResumePoint point = full_point();
  const std::string token = ours.seal(point, kNow);
  std::string forged = token;
  forged[40] = static_cast<char>(forged[40] ^ 1);
  const std::set<std::string> words = {
      refusal(ours, forged, point.session),
      refusal(ours, token.substr(0, 60), point.session),
      refusal(ours, std::string(2000, 'x'), point.session),
      refusal(keys(key('b')), token, point.session),
      refusal(ours, token, point.session, kNow + kTtl),
      refusal(ours, token, "other"),
  };
  EXPECT_EQ(words.size(), 6u);
  EXPECT_EQ(words.count(""), 0u);
}

TEST(KeyFile, CommentsEmptyLinesAndEitherCaseAreRead) {
  const TokenKeys plain = keys(key('a'));
  const TokenKeys decorated = keys("# ours\n\n  " + key('A') + " \r\n#" + key('b') + "\n");
  EXPECT_EQ(plain.seal(full_point(), kNow), decorated.seal(full_point(), kNow));
}

TEST(KeyFile, RefusesWhatIsNoKeyAndNamesTheLine) {
  const std::string good = key('a') + "\n";
  for (const std::string& bad : {std::string(62, 'a'), key('a') + "a", key('g'), std::string("secret")}) {
    const TemporaryFile file(good + bad + "\n");
    const absl::Status status = TokenKeys::read(file.path()).status();
    EXPECT_REFUSED(kInvalidArgument, "line 2", status);
    EXPECT_FALSE(says(status.message(), bad.substr(0, 6))) << "a message shows a key: " << status;
  }
}

TEST(KeyFile, RefusesNoKeyAndTooMany) {
  const TemporaryFile none("# nothing yet\n");
  EXPECT_TRUE(says(TokenKeys::read(none.path()).status().message(), "openssl rand -hex 32"));
  std::string lines;
  for (size_t i = 0; i < kMaxKeys; ++i) lines += key("0123456789abcdef"[i]) + "\n";
  EXPECT_OK(TokenKeys::read(TemporaryFile(lines).path()));
  EXPECT_REFUSED(kInvalidArgument, "", TokenKeys::read(TemporaryFile(lines + key('a') + key('a')).path()));
}

TEST(KeyFile, RefusesAFileThatOthersMayReadOrChange) {
  for (const mode_t mode : {0604, 0620, 0602, 0644, 0666}) {
    const TemporaryFile file(key('a'), mode);
    EXPECT_REFUSED(kFailedPrecondition, "chmod 600 " + file.path(), TokenKeys::read(file.path()));
  }
  for (const mode_t mode : {0400, 0600, 0440, 0640}) {
    EXPECT_OK(TokenKeys::read(TemporaryFile(key('a'), mode).path())) << mode;
  }
}

TEST(KeyFile, RefusesWhatCannotBeRead) {
  EXPECT_TRUE(absl::IsNotFound(TokenKeys::read("/no/such/file").status()));
  EXPECT_TRUE(absl::IsNotFound(TokenKeys::read(::testing::TempDir()).status()));
  EXPECT_REFUSED(kInvalidArgument, "70000 bytes",
                 TokenKeys::read(TemporaryFile(std::string(70000, '#')).path()));
}

TEST(SettingsHash, TellsSettingsApartAndOnlyThem) {
  v1::Settings one;
  EXPECT_EQ(settings_hash(one).size(), 16u);
  v1::Settings same;
  one.set_prescale(2.0);
  same.set_prescale(2.0);
  EXPECT_EQ(settings_hash(one), settings_hash(same));
  EXPECT_NE(settings_hash(one), settings_hash(v1::Settings()));
  same.mutable_table()->set_values("x");
  EXPECT_NE(settings_hash(one), settings_hash(same));
}

}  // namespace
}  // namespace candela
