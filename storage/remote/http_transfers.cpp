#include "isobrick/storage/remote/http_transfers.h"

#include <curl/curl.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <condition_variable>
#include <cstdlib>
#include <list>
#include <mutex>
#include <string_view>

#include "isobrick/storage/error.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

constexpr std::size_t kMostHeaderBytes = std::size_t{64} << 10;
// The body of a refused answer is read to its end if it is that short: the connection stays.
constexpr std::uint64_t kShortBody = std::uint64_t{64} << 10;
// Fewer bytes a second are none.
constexpr long kLeastRate = 64;

bool initCurl() {
  static const bool is_ready = curl_global_init(CURL_GLOBAL_DEFAULT) == CURLE_OK;
  return is_ready;
}

// The file that a variable names; otherwise the system's, as a libcurl that came in a Python wheel
// knows Debian's place alone. Null: libcurl's own.
const char* certificateFile() {
  for (const char* const name : {"CURL_CA_BUNDLE", "AWS_CA_BUNDLE", "SSL_CERT_FILE"})
    if (const char* const file = std::getenv(name); file != nullptr && *file != '\0') return file;
  for (const char* const file : {"/etc/ssl/certs/ca-certificates.crt",  // Debian, Arch
                                 "/etc/pki/tls/certs/ca-bundle.crt",    // Fedora
                                 "/etc/ssl/ca-bundle.pem",              // openSUSE
                                 "/etc/ssl/cert.pem"})                  // Alpine
    if (access(file, R_OK) == 0) return file;
  return nullptr;
}

// One request that is underway.
class Exchange {
 public:
  Exchange(HttpClient& client, const HttpRequest& request, double stall_seconds)
      : client_(client), id_(request.id), follows_(request.follows_redirects) {
    easy_ = curl_easy_init();
    if (easy_ == nullptr) throw std::bad_alloc();
    for (const std::string& header : request.headers) {
      curl_slist* const longer = curl_slist_append(headers_, header.c_str());
      if (longer == nullptr) {
        release();
        throw std::bad_alloc();
      }
      headers_ = longer;
    }
    set(CURLOPT_URL, request.url.c_str());
    set(CURLOPT_HTTPHEADER, headers_);
    const std::string range =
        request.end_bytes > 0 ? "-" + std::to_string(request.end_bytes)
                              : std::to_string(request.first) + "-" + std::to_string(request.last);
    set(CURLOPT_RANGE, range.c_str());
    set(CURLOPT_USERAGENT, "isobrick");
    // "a/../b" may be the name of an object; later libcurls do not sign such names (S3Object
    // refuses them).
    set(CURLOPT_PATH_AS_IS, request.signature ? 0L : 1L);
    set(CURLOPT_PROTOCOLS_STR, "http,https");
    set(CURLOPT_HTTP_VERSION, static_cast<long>(CURL_HTTP_VERSION_2TLS));
    const bool is_secure = lowercase(request.url.substr(0, 6)) == "https:";
    // A second connection only if the first cannot carry more. Without TLS none can.
    set(CURLOPT_PIPEWAIT, is_secure ? 1L : 0L);
    set(CURLOPT_FOLLOWLOCATION, follows_ ? 1L : 0L);
    set(CURLOPT_MAXREDIRS, static_cast<long>(HttpTransfers::kMostRedirects));
    set(CURLOPT_REDIR_PROTOCOLS_STR, is_secure ? "https" : "http,https");
    if (request.signature) {
      set(CURLOPT_AWS_SIGV4, ("aws:amz:" + request.signature->region + ":s3").c_str());
      set(CURLOPT_USERNAME, request.signature->id.c_str());
      set(CURLOPT_PASSWORD, request.signature->secret.c_str());
    }
    set(CURLOPT_NETRC, static_cast<long>(CURL_NETRC_OPTIONAL));
    set(CURLOPT_SUPPRESS_CONNECT_HEADERS, 1L);
    set(CURLOPT_CONNECTTIMEOUT_MS, static_cast<long>(1000 * HttpTransfers::kConnectSeconds));
    set(CURLOPT_TIMEOUT_MS, static_cast<long>(1000 * HttpTransfers::kMostSeconds));
    set(CURLOPT_LOW_SPEED_LIMIT, kLeastRate);
    set(CURLOPT_LOW_SPEED_TIME, std::max(1L, std::lround(stall_seconds)));
    set(CURLOPT_NOSIGNAL, 1L);
    set(CURLOPT_QUICK_EXIT, 1L);  // a name that does not resolve delays no exit
    set(CURLOPT_ERRORBUFFER, error_.data());
    if (const char* const file = certificateFile()) set(CURLOPT_CAINFO, file);
    set(CURLOPT_PRIVATE, this);
    set(CURLOPT_HEADERDATA, this);
    set(CURLOPT_HEADERFUNCTION, &Exchange::takeHeader);
    set(CURLOPT_WRITEDATA, this);
    set(CURLOPT_WRITEFUNCTION, &Exchange::takeBytes);
  }
  ~Exchange() { release(); }
  Exchange(const Exchange&) = delete;

  CURL* easy() const { return easy_; }
  HttpClient& client() const { return client_; }
  std::uint64_t id() const { return id_; }

  HttpEnd end(CURLcode code) const {
    HttpEnd end;
    end.was_refused = was_refused_ || is_swallowing_;
    end.is_whole = code == CURLE_OK && is_judged_ && !end.was_refused;
    char* url = nullptr;
    if (curl_easy_getinfo(easy_, CURLINFO_EFFECTIVE_URL, &url) == CURLE_OK && url != nullptr)
      end.url = url;
    if (end.is_whole || end.was_refused) return end;
    describe(code, end);
    return end;
  }

 private:
  template <typename T>
  void set(CURLoption option, T value) {
    curl_easy_setopt(easy_, option, value);
  }
  void release() {
    curl_easy_cleanup(easy_);
    curl_slist_free_all(headers_);
  }

  void describe(CURLcode code, HttpEnd& end) const {
    if (has_too_many_headers_) {
      end.text = "the server sends headers without end; check the address";
      return;
    }
    const std::string said = error_[0] != '\0' ? error_.data() : curl_easy_strerror(code);
    switch (code) {
      case CURLE_COULDNT_RESOLVE_HOST:
      case CURLE_COULDNT_RESOLVE_PROXY:
      case CURLE_COULDNT_CONNECT:
        end.is_unreached = end.may_pass = true;
        end.text = "the server cannot be reached (" + said + "); check address and network";
        return;
      case CURLE_OPERATION_TIMEDOUT:
        end.may_pass = true;
        end.text = "the server hangs (no answer within the time limit); try again later";
        return;
      case CURLE_GOT_NOTHING:
      case CURLE_SEND_ERROR:
      case CURLE_RECV_ERROR:
      case CURLE_PARTIAL_FILE:
      case CURLE_HTTP2:
      case CURLE_HTTP2_STREAM:
        end.may_pass = true;
        end.text = code == CURLE_PARTIAL_FILE
                       ? "the server sends fewer bytes than it says; try again later"
                       : "the connection breaks off (" + said + "); try again later";
        return;
      case CURLE_TOO_MANY_REDIRECTS:
        end.text = "the server redirects more than " +
                   std::to_string(HttpTransfers::kMostRedirects) + " times; check the address";
        return;
      case CURLE_PEER_FAILED_VERIFICATION:
      case CURLE_SSL_CACERT_BADFILE:
      case CURLE_SSL_CONNECT_ERROR:
        end.text = "the server's certificate or TLS is not accepted (" + said +
                   "); check the address, or name its authority's file in CURL_CA_BUNDLE";
        return;
      case CURLE_OK:  // without the head of an answer
      case CURLE_WRITE_ERROR:
        end.text = "the server does not answer as HTTP has it (no status); check the address";
        return;
      case CURLE_UNSUPPORTED_PROTOCOL:
      case CURLE_WEIRD_SERVER_REPLY:
        end.text = "the server does not answer as HTTP has it (" + said + "); check the address";
        return;
      case CURLE_URL_MALFORMAT:
        end.text = "the address is not a URL (" + said + "); check it";
        return;
      default:
        end.text = "the request fails (" + said + "); check address and network";
        return;
    }
  }

  static std::size_t takeHeader(char* data, std::size_t size, std::size_t count, void* self) {
    auto& exchange = *static_cast<Exchange*>(self);
    return exchange.noteHeader({data, size * count}) ? size * count : 0;
  }

  bool noteHeader(std::string_view line) {
    header_bytes_ += line.size();
    if (header_bytes_ > kMostHeaderBytes) return !(has_too_many_headers_ = true);
    const std::string_view text = trimmed(line);
    if (text.starts_with("HTTP/")) {
      head_ = {};
      has_location_ = false;
      const std::size_t blank = text.find(' ');
      if (blank != std::string_view::npos)
        std::from_chars(text.data() + blank + 1, text.data() + text.size(), head_.status);
      return true;
    }
    if (text.empty()) return endHead();
    const std::size_t colon = text.find(':');
    if (colon == std::string_view::npos) return true;
    const std::string name = lowercase(std::string(text.substr(0, colon)));
    const std::string_view value = trimmed(text.substr(colon + 1));
    if (name == "content-range") head_.content_range = value;
    if (name == "content-encoding") head_.content_encoding = value;
    if (name == "etag") head_.etag = value;
    if (name == "last-modified") head_.last_modified = value;
    if (name == "retry-after") head_.retry_after = value;
    if (name == "x-amz-bucket-region") head_.bucket_region = value;
    if (name == "location") has_location_ = !value.empty();  // libcurl follows no other
    if (name == "content-length") {
      std::uint64_t length = 0;
      const char* const end = value.data() + value.size();
      const auto [at, error] = std::from_chars(value.data(), end, length);
      if (error == std::errc() && at == end) head_.content_length = length;
    }
    return true;
  }

  // The head of an answer; not that of a redirect which is followed, or of a note that the answer
  // is to come. Trailers end like this too.
  bool endHead() {
    if (head_.status < 200 || is_judged_) return true;
    if (follows_ && has_location_ && head_.status >= 300 && head_.status < 400) return true;
    is_judged_ = true;
    if (client_.onHead(id_, head_)) return true;
    is_swallowing_ = head_.content_length && *head_.content_length <= kShortBody;
    was_refused_ = !is_swallowing_;
    return is_swallowing_;
  }

  static std::size_t takeBytes(char* data, std::size_t size, std::size_t count, void* self) {
    auto& exchange = *static_cast<Exchange*>(self);
    const std::size_t bytes = size * count;
    if (!exchange.is_judged_) return 0;  // libcurl takes "HTTP/" and anything for a good head
    if (exchange.is_swallowing_) {
      exchange.swallowed_ += bytes;
      return exchange.swallowed_ <= kShortBody ? bytes : 0;
    }
    if (exchange.client_.onBytes(exchange.id_, {reinterpret_cast<const std::byte*>(data), bytes}))
      return bytes;
    exchange.was_refused_ = true;
    return 0;
  }

  HttpClient& client_;
  const std::uint64_t id_;
  const bool follows_;
  CURL* easy_ = nullptr;
  curl_slist* headers_ = nullptr;
  std::array<char, CURL_ERROR_SIZE> error_{};
  HttpHead head_;
  std::size_t header_bytes_ = 0;
  std::uint64_t swallowed_ = 0;
  bool has_too_many_headers_ = false;
  bool has_location_ = false;
  bool is_judged_ = false;
  bool is_swallowing_ = false;  // the body of an answer that the client refused
  bool was_refused_ = false;
};

}  // namespace

class HttpTransfers::Loop {
 public:
  explicit Loop(double stall_seconds) : stall_seconds_(stall_seconds) {
    if (initCurl()) multi_ = curl_multi_init();
    if (multi_ == nullptr)
      throw Error("the network cannot be used: libcurl does not start; free some memory");
    curl_multi_setopt(multi_, CURLMOPT_PIPELINING, static_cast<long>(CURLPIPE_MULTIPLEX));
    curl_multi_setopt(multi_, CURLMOPT_MAX_HOST_CONNECTIONS, static_cast<long>(kMostConnections));
    curl_multi_setopt(multi_, CURLMOPT_MAXCONNECTS, static_cast<long>(kMostConnections));
    try {
      thread_ = std::thread([this] { run(); });
    } catch (const std::exception&) {
      curl_multi_cleanup(multi_);
      throw Error("the network cannot be used: the system gives no thread; end some processes");
    }
  }
  ~Loop() {
    stops_ = true;
    wake();
    thread_.join();
    curl_multi_cleanup(multi_);
  }
  Loop(const Loop&) = delete;

  void enter(HttpClient& client) {
    const std::lock_guard lock(mutex_);
    clients_.push_back(&client);
  }
  void leave(HttpClient& client) {
    std::unique_lock lock(mutex_);
    leaving_.push_back(&client);
    wake();
    left_.wait(lock, [&] {
      return std::find(leaving_.begin(), leaving_.end(), &client) == leaving_.end();
    });
  }
  void wake() { curl_multi_wakeup(multi_); }

 private:
  void run() {
    // Signals are for the threads of the program; a connection that broke is no signal here.
    sigset_t all;
    sigfillset(&all);
    pthread_sigmask(SIG_BLOCK, &all, nullptr);
    while (!stops_) {
      std::chrono::milliseconds wait(1000);
      dropLeaving();
      begin(wait);
      int running = 0;
      curl_multi_perform(multi_, &running);
      if (finish()) continue;
      curl_multi_poll(multi_, nullptr, 0, static_cast<int>(wait.count()), nullptr);
    }
  }

  void dropLeaving() {
    const std::lock_guard lock(mutex_);
    if (leaving_.empty()) return;
    for (const HttpClient* const client : leaving_) {
      std::erase(clients_, client);
      std::erase_if(exchanges_, [&](const auto& exchange) {
        if (&exchange->client() != client) return false;
        curl_multi_remove_handle(multi_, exchange->easy());
        return true;
      });
    }
    leaving_.clear();
    left_.notify_all();
  }

  // One request of each client in turn, until none has more. A client that leaves meanwhile waits
  // for dropLeaving().
  void begin(std::chrono::milliseconds& wait) {
    std::vector<HttpClient*> asked;
    {
      const std::lock_guard lock(mutex_);
      asked = clients_;
    }
    if (!asked.empty())
      std::rotate(asked.begin(), asked.begin() + turn_++ % asked.size(), asked.end());
    while (!asked.empty())
      std::erase_if(asked, [&](HttpClient* client) {
        return exchanges_.size() >= kMostRequests || !beginOne(*client, wait);
      });
  }

  // False if the client has no request now.
  bool beginOne(HttpClient& client, std::chrono::milliseconds& wait) {
    const std::optional<HttpRequest> request = client.nextRequest(&wait);
    if (!request) return false;
    HttpEnd end;
    try {
      auto exchange = std::make_unique<Exchange>(client, *request, stall_seconds_);
      const CURLMcode code = curl_multi_add_handle(multi_, exchange->easy());
      if (code == CURLM_OK) {
        exchanges_.push_back(std::move(exchange));
        return true;
      }
      end.text = "the request cannot be sent (" + std::string(curl_multi_strerror(code)) +
                 "); free some memory";
    } catch (const std::bad_alloc&) {
      end.text = "no memory is left; free some";
    }
    client.onEnd(request->id, end);
    return true;
  }

  // True if any has ended.
  bool finish() {
    bool has_ended = false;
    int left = 0;
    while (const CURLMsg* const message = curl_multi_info_read(multi_, &left)) {
      if (message->msg != CURLMSG_DONE) continue;
      has_ended = true;
      CURL* const easy = message->easy_handle;
      const CURLcode code = message->data.result;
      const auto found =
          std::find_if(exchanges_.begin(), exchanges_.end(),
                       [&](const auto& exchange) { return exchange->easy() == easy; });
      const HttpEnd end = (*found)->end(code);
      const std::uint64_t id = (*found)->id();
      HttpClient& client = (*found)->client();
      curl_multi_remove_handle(multi_, easy);
      exchanges_.erase(found);
      client.onEnd(id, end);
    }
    return has_ended;
  }

  const double stall_seconds_;
  CURLM* multi_ = nullptr;
  std::list<std::unique_ptr<Exchange>> exchanges_;
  std::size_t turn_ = 0;  // of the client that is asked first
  std::mutex mutex_;      // guards the three below
  std::vector<HttpClient*> clients_, leaving_;
  std::condition_variable left_;
  std::atomic<bool> stops_{false};
  std::thread thread_;
};

HttpTransfers::HttpTransfers(double stall_seconds) : loop_(std::make_unique<Loop>(stall_seconds)) {}
HttpTransfers::~HttpTransfers() = default;
void HttpTransfers::enter(HttpClient& client) { loop_->enter(client); }
void HttpTransfers::leave(HttpClient& client) { loop_->leave(client); }
void HttpTransfers::wake() { loop_->wake(); }

}  // namespace isobrick
