"""Traces of episodes across processes, by OpenTelemetry.

Each worker computes the trace of an episode: the ids of the trace, and of the span of the whole episode, are digests of
run and episode. So leases carry no trace. Requests carry the span that they belong to in their envelope
(`common/bus/envelope.py`); without `--traces` they carry none.
"""

import contextlib
import hashlib
import json
import threading
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import readygo
from readygo.common.bus.envelope import TRACE
from readygo.common.errors import ConfigError, reason
from readygo.common.extras import install_command
from readygo.common.fleet.at_work import AT_WORK, AtWork

Attributes = Mapping[str, str | int]


class Traces:
    """The spans of one process."""

    def __init__(self, where: str, *, run: str, role: str, worker: str) -> None:
        """Begin to trace.

        Args:
            where: An OTLP endpoint (http://HOST:4318), or a folder for a file WORKER.jsonl.
            run: Name of the run.
            role: Role of this process.
            worker: Name of this process.

        Raises:
            ConfigError: If OpenTelemetry is not installed, or the folder cannot be written.
        """
        try:
            from opentelemetry import trace
            from opentelemetry.sdk.resources import Resource
            from opentelemetry.sdk.trace import TracerProvider
            from opentelemetry.sdk.trace.export import BatchSpanProcessor
            from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator

            exporter = _exporter(where, worker)
        except ImportError as error:
            raise ConfigError(f"--traces needs OpenTelemetry; run: {install_command('otel')}") from error
        resource = Resource.create(
            {
                "service.name": f"readygo-{role}",
                "service.version": readygo.__version__,
                "service.instance.id": worker,
                "readygo.run": run,
            }
        )
        self._numbers = _numbers()
        self._provider = TracerProvider(resource=resource, id_generator=self._numbers, shutdown_on_exit=False)
        self._provider.add_span_processor(BatchSpanProcessor(exporter))
        self._tracer = self._provider.get_tracer("readygo", readygo.__version__)
        self._trace, self._propagator, self._run = trace, TraceContextTextMapPropagator(), run

    @contextlib.contextmanager
    def stage(self, at_work: AtWork) -> Iterator[None]:
        """Record the span of a stage, within its episode's span; errors are recorded."""
        attributes: Attributes = {"readygo.episode": at_work.episode, "readygo.attempt": at_work.attempt}
        with self._spanned(at_work.stage, self._of_episode(at_work.episode), "internal", attributes):
            yield

    @contextlib.contextmanager
    def requesting(self, topic: str) -> Iterator[None]:
        """Record the span of a request within a traced stage or request."""
        parent = self._parent()
        if parent is None:
            yield
            return
        with self._spanned(f"request {topic}", parent, "client", {}):
            carrier: dict[str, str] = {}
            self._propagator.inject(carrier)
            before = TRACE.set(carrier.get("traceparent", ""))
            try:
                yield
            finally:
                TRACE.reset(before)

    @contextlib.contextmanager
    def handling(self, topic: str) -> Iterator[None]:
        """Record the span of handling a request that carries a trace."""
        trace = TRACE.get()
        if not trace:
            yield
            return
        with self._spanned(topic, self._propagator.extract({"traceparent": trace}), "server", {}):
            yield

    def episode(self, episode: str, begin_ns: int, end_ns: int, attributes: Attributes) -> None:
        """Record the span of a whole episode, once it is durable; times by the wall clock [ns]."""
        self._numbers.following = trace_numbers(self._run, episode)
        try:
            span = self._tracer.start_span(
                "episode",
                context=self._trace.set_span_in_context(self._trace.INVALID_SPAN),
                start_time=begin_ns,
                attributes={"readygo.episode": episode, **attributes},
            )
        finally:
            self._numbers.following = None
        span.end(end_ns)

    def close(self) -> None:
        """Export the waiting spans."""
        self._provider.shutdown()

    def _parent(self) -> Any:
        """The trace context of this thread; None outside of a trace."""
        if self._trace.get_current_span().get_span_context().is_valid:
            return self._trace.set_span_in_context(self._trace.get_current_span())
        at_work = AT_WORK.get()
        return self._of_episode(at_work.episode) if at_work else None

    def _of_episode(self, episode: str) -> Any:
        trace_number, span_number = trace_numbers(self._run, episode)
        sampled = self._trace.TraceFlags(self._trace.TraceFlags.SAMPLED)
        span = self._trace.SpanContext(trace_number, span_number, is_remote=True, trace_flags=sampled)
        return self._trace.set_span_in_context(self._trace.NonRecordingSpan(span))

    @contextlib.contextmanager
    def _spanned(self, name: str, parent: Any, kind: str, attributes: Attributes) -> Iterator[None]:
        kinds = self._trace.SpanKind
        with self._tracer.start_as_current_span(
            name, context=parent, kind=kinds[kind.upper()], attributes=dict(attributes)
        ) as span:
            try:
                yield
            except Exception as error:
                span.set_status(self._trace.StatusCode.ERROR, reason(error))
                raise


def trace_numbers(run: str, episode: str) -> tuple[int, int]:
    """Ids of an episode's trace (128 bits) and of the span of the whole episode (64 bits)."""
    digest = hashlib.sha256(f"{run}/{episode}".encode()).digest()
    return int.from_bytes(digest[:16], "big"), int.from_bytes(digest[16:24], "big")


def _numbers() -> Any:
    """An id generator that returns preset ids if there are any, else random ones."""
    from opentelemetry.sdk.trace.id_generator import RandomIdGenerator

    class Numbers(RandomIdGenerator):
        def __init__(self) -> None:
            self._due = threading.local()

        @property
        def following(self) -> tuple[int, int] | None:
            return getattr(self._due, "numbers", None)

        @following.setter
        def following(self, numbers: tuple[int, int] | None) -> None:
            self._due.numbers = numbers

        def generate_trace_id(self) -> int:
            return self.following[0] if self.following else super().generate_trace_id()

        def generate_span_id(self) -> int:
            return self.following[1] if self.following else super().generate_span_id()

    return Numbers()


def _exporter(where: str, worker: str) -> Any:
    if where.startswith(("http://", "https://")):
        from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter

        return OTLPSpanExporter(endpoint=f"{where.rstrip('/')}/v1/traces")
    return _to_file(Path(where) / f"{worker}.jsonl")


def _to_file(path: Path) -> Any:
    """An exporter of JSON lines, for use without a collector."""
    from opentelemetry.sdk.trace.export import SpanExporter, SpanExportResult

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("a")
    except OSError as error:
        raise ConfigError(f"--traces cannot write {path}: {error.strerror}.") from error

    class Lines(SpanExporter):
        def export(self, spans: Sequence[Any]) -> Any:
            try:
                file.write("".join(json.dumps(_plain(span), ensure_ascii=False) + "\n" for span in spans))
                file.flush()
            except (OSError, ValueError):
                return SpanExportResult.FAILURE
            return SpanExportResult.SUCCESS

        def shutdown(self) -> None:
            file.close()

    return Lines()


def _plain(span: Any) -> dict[str, Any]:
    own, parent = span.get_span_context(), span.parent
    return {
        "name": span.name,
        "trace": f"{own.trace_id:032x}",
        "span": f"{own.span_id:016x}",
        "parent": f"{parent.span_id:016x}" if parent else "",
        "kind": span.kind.name.lower(),
        "start_ns": span.start_time,
        "end_ns": span.end_time,
        "status": span.status.status_code.name.lower(),
        "words": span.status.description or "",
        "attributes": dict(span.attributes or {}),
        "service": span.resource.attributes["service.name"],
        "worker": span.resource.attributes["service.instance.id"],
        "run": span.resource.attributes["readygo.run"],
    }
