// Whether a request of the page has been waiting for longer than a person likes.
//
// window.fetch is wrapped and hands through exactly what it is given and what it gets. Sending a file takes its
// time without anybody being slow, so requests that carry one are not counted; nor is a Request that may, because
// not every browser tells what is in it.

const SLOW_AFTER_MS = 1000;
const WAITING_MAX = 200;

function isUpload(body) {
  return body instanceof FormData || body instanceof Blob || body instanceof ArrayBuffer || ArrayBuffer.isView(body)
    || body instanceof ReadableStream;
}

/** Watch this page's requests. `changed` is called when they become slow or stop being so. */
export function watchRequests(changed) {
  const slow = new Set();
  const plain = window.fetch;
  let waiting = 0;

  window.fetch = function fetch(...given) {
    const answer = plain.apply(this, given);
    const mayCarry = given[0] instanceof Request && given[0].method !== "GET";
    if (!mayCarry && !isUpload(given[1]?.body) && waiting < WAITING_MAX) watch(answer);
    return answer;
  };

  function watch(answer) {
    waiting += 1;
    const timer = setTimeout(() => { slow.add(answer); changed(); }, SLOW_AFTER_MS);
    const settled = () => {
      waiting -= 1;
      clearTimeout(timer);
      if (slow.delete(answer)) changed();
    };
    answer.then(settled, settled);
  }

  return { isSlow: () => slow.size > 0 };
}
