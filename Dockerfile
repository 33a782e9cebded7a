# The household ledger with its guard; the launcher is PID 1 and reaps whoever is orphaned.
# Only loopback is served (there is no sign-in yet), so what is inside is reached through the host's own network
# (compose.yaml), or by whatever runs in the same network namespace.
FROM python:3.13-slim AS build
ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1
WORKDIR /app
COPY requirements.lock pyproject.toml README.md LICENSE ./
RUN python -m venv /venv && /venv/bin/pip install --require-hashes -r requirements.lock
COPY hardcore hardcore
COPY core core
COPY postmortem postmortem
COPY frontend frontend
COPY templates templates
RUN /venv/bin/pip install --no-deps --no-build-isolation .

FROM python:3.13-slim
RUN useradd --uid 10001 --create-home --shell /usr/sbin/nologin ledger \
    && install -d -o ledger -g ledger -m 0700 /data
COPY --from=build /venv /venv
COPY --chmod=0755 scripts/probe /usr/local/bin/hardcore-probe
ENV PATH=/venv/bin:$PATH HARDCORE_DATA=/data PYTHONUNBUFFERED=1 HARDCORE_PORT=3000
USER ledger
VOLUME ["/data"]
STOPSIGNAL SIGTERM
HEALTHCHECK --interval=10s --timeout=3s --start-period=60s --retries=6 CMD ["hardcore-probe", "/livez"]
# `up` becomes the launcher by exec, so the shell, too, has to become `up`.
CMD ["sh", "-c", "exec hardcore up --port \"$HARDCORE_PORT\""]
