#include "client/call/retry_schedule.h"

#include <google/protobuf/any.pb.h>
#include <google/protobuf/duration.pb.h>
#include <google/protobuf/unknown_field_set.h>

#include <algorithm>
#include <string>
#include <vector>

#include "absl/strings/cord.h"
#include "absl/strings/match.h"
#include "server/base/check.h"

namespace candela {
namespace {

constexpr char kDelayPayload[] = "candela.retry_delay";

// The length-delimited values of field `number` in a message. Parsed by hand because Debian does not package
// google.rpc's protos.
std::vector<std::string> fields_of(const std::string& message, int number) {
  google::protobuf::UnknownFieldSet all;
  std::vector<std::string> found;
  if (!all.ParseFromString(message)) return found;
  for (int i = 0; i < all.field_count(); ++i) {
    const google::protobuf::UnknownField& field = all.field(i);
    if (field.number() == number && field.type() == google::protobuf::UnknownField::TYPE_LENGTH_DELIMITED) {
      found.push_back(field.length_delimited());
    }
  }
  return found;
}

}  // namespace

// google.rpc.Status: details = 3, each an Any. google.rpc.RetryInfo: retry_delay = 1.
absl::Duration retry_delay(const grpc::Status& status) {
  for (const std::string& detail : fields_of(status.error_details(), 3)) {
    google::protobuf::Any any;
    if (!any.ParseFromString(detail) || !absl::EndsWith(any.type_url(), "/google.rpc.RetryInfo")) continue;
    for (const std::string& bytes : fields_of(any.value(), 1)) {
      google::protobuf::Duration delay;
      if (!delay.ParseFromString(bytes)) continue;
      return std::max(absl::ZeroDuration(),
                      absl::Seconds(delay.seconds()) + absl::Nanoseconds(delay.nanos()));
    }
  }
  return absl::ZeroDuration();
}

void set_retry_delay(absl::Status& status, absl::Duration delay) {
  status.SetPayload(kDelayPayload, absl::Cord(absl::FormatDuration(delay)));
}

std::optional<absl::Duration> noted_retry_delay(const absl::Status& status) {
  const absl::optional<absl::Cord> noted = status.GetPayload(kDelayPayload);
  absl::Duration delay;
  if (!noted || !absl::ParseDuration(std::string(*noted), &delay)) return std::nullopt;
  return delay;
}

namespace {

constexpr absl::Duration kFirstPause = absl::Milliseconds(50);
constexpr absl::Duration kLongestPause = absl::Seconds(1);
constexpr double kMostJitter = 0.5;

}  // namespace

void RetrySchedule::failed(absl::Time now, absl::Duration delay, bool progress) {
  const size_t servers = not_before_.size();
  CHECK(next_ < servers && delay >= absl::ZeroDuration());
  const auto jittered = [this](absl::Duration pause) {
    return pause * std::uniform_real_distribution<>(1, 1 + kMostJitter)(random_);
  };
  attempts_ = progress ? 1 : attempts_ + 1;
  not_before_[next_] = now + jittered(delay);
  next_ = (next_ + 1) % servers;
  when_ = now;
  if (attempts_ > 1 && attempts_ % servers == 0) {
    const size_t rounds = std::min<size_t>(attempts_ / servers - 1, 10);
    when_ += jittered(std::min(kLongestPause, kFirstPause * (int64_t{1} << rounds)));
  }
  when_ = std::max(when_, not_before_[next_]);
  CHECK(when_ >= now);
}

}  // namespace candela
