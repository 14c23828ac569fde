"""Rows in memory to columns in registers (one vector per entry, a row per lane) and back, in LLVM IR."""

from collections.abc import Iterator

from .types import Type


def declarations(t: Type) -> Iterator[str]:
    """The intrinsics that the code here calls."""
    if t.lanes > 1:
        yield f"declare {t.float} @llvm.masked.load.{t.name}.p0(ptr, i32, {t.bool}, {t.float})"
        yield f"declare void @llvm.masked.store.{t.name}.p0({t.float}, ptr, i32, {t.bool})"


def gathered(t: Type, name: str, rows: list[str], size: int) -> tuple[list[str], list[str]]:
    """Names of the columns (one vector per entry, a row per lane) of rows in memory, and the code that gathers them."""
    F, L, columns, lines = t.float, t.lanes, [], []
    if L == 1:
        for j in range(size):
            lines.append(f"  %{name}a{j} = getelementptr {t.scalar}, ptr {rows[0]}, i64 {j}")
            lines.append(f"  %{name}c{j} = load {t.scalar}, ptr %{name}a{j}, align {t.bytes}")
            columns.append(f"%{name}c{j}")
        return columns, lines
    for start in range(0, size, L):
        width = min(L, size - start)
        loaded = []
        for i, row in enumerate(rows):
            lines.append(f"  %{name}a{start}_{i} = getelementptr {t.scalar}, ptr {row}, i64 {start}")
            value = f"%{name}l{start}_{i}"
            if width == L:
                lines.append(f"  {value} = load {F}, ptr %{name}a{start}_{i}, align {t.bytes}")
            else:
                arguments = f"ptr %{name}a{start}_{i}, i32 {t.bytes}, {t.bool} {_mask(L, width)}, {F} zeroinitializer"
                lines.append(f"  {value} = call {F} @llvm.masked.load.{t.name}.p0({arguments})")
            loaded.append(value)
        transposed, text = _transposed(t, f"{name}t{start}", loaded)
        lines += text
        columns += transposed[:width]
    return columns, lines


def scattered(t: Type, name: str, rows: list[str], columns: list[str]) -> Iterator[str]:
    """Code that writes columns (a row per lane) to rows in memory."""
    F, L = t.float, t.lanes
    if L == 1:
        for j, value in enumerate(columns):
            yield f"  %{name}a{j} = getelementptr {t.scalar}, ptr {rows[0]}, i64 {j}"
            yield f"  store {t.scalar} {value}, ptr %{name}a{j}, align {t.bytes}"
        return
    for start in range(0, len(columns), L):
        group = columns[start : start + L]
        padded = group + [group[-1]] * (L - len(group))
        transposed, text = _transposed(t, f"{name}t{start}", padded)
        yield from text
        for i, (row, value) in enumerate(zip(rows, transposed, strict=True)):
            yield f"  %{name}a{start}_{i} = getelementptr {t.scalar}, ptr {row}, i64 {start}"
            if len(group) == L:
                yield f"  store {F} {value}, ptr %{name}a{start}_{i}, align {t.bytes}"
            else:
                arguments = f"{F} {value}, ptr %{name}a{start}_{i}, i32 {t.bytes}, {t.bool} {_mask(L, len(group))}"
                yield f"  call void @llvm.masked.store.{t.name}.p0({arguments})"


def _mask(lanes: int, width: int) -> str:
    return "<" + ", ".join(f"i1 {int(k < width)}" for k in range(lanes)) + ">"


def _transposed(t: Type, name: str, rows: list[str]) -> tuple[list[str], list[str]]:
    """A square of lanes × lanes numbers, transposed in steps between rows that are k = 1, 2, 4, … apart.

    Within 16 bytes, blocks of k numbers are swapped. Beyond, one row takes the even of both rows' pieces of 16 bytes, the other the odd
    ones: machines have one instruction for either.
    """
    F, L, rows, lines = t.float, t.lanes, list(rows), []
    piece = 16 // t.bytes
    k = 1
    while k < L:
        if k < piece:
            low = [j if not j & k else L + j - k for j in range(L)]
            high = [j + k if not j & k else L + j for j in range(L)]
        else:
            low, high = ([j for j in range(2 * L) if j // piece % 2 == odd] for odd in (0, 1))
        for i in range(L):
            if i & k:
                continue
            a, b = rows[i], rows[i + k]
            for target, mask in ((i, low), (i + k, high)):
                text = ", ".join(f"i32 {m}" for m in mask)
                lines.append(f"  %{name}_{k}_{target} = shufflevector {F} {a}, {F} {b}, <{L} x i32> <{text}>")
                rows[target] = f"%{name}_{k}_{target}"
        k *= 2
    return rows, lines
