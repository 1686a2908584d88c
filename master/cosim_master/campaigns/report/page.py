"""The page of a report on a campaign."""

from __future__ import annotations

from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from cosim_master.campaigns.dataset.folder import read_runs
from cosim_master.campaigns.dataset.table import digest_of
from cosim_master.campaigns.report import tables
from cosim_master.campaigns.report.analysis import Finished, read_campaign
from cosim_master.campaigns.report.drawing import curves, heat_maps
from cosim_master.report.markup import escaped, image, table, write_document

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["write_campaign_report"]


def write_campaign_report(folder: Path, file: Path | None = None) -> Path:
    """Writes a report on a campaign, whether it is complete or not.

    Args:
        folder: of the campaign.
        file: the file to write; its folder is created if necessary. None: report.html in the folder.

    Returns:
        The file written.

    Raises:
        CosimError: the folder holds no campaign, its dataset is damaged, or the file cannot be written.
    """
    campaign = read_campaign(folder)
    source = f"uav-cosim, runs sha256 {digest_of(read_runs(folder))}"
    name = Path(campaign.study.system).stem
    return write_document(file or folder / "report.html", f"Campaign: {name}", source, _body(campaign, name))


def _body(campaign: Finished, name: str) -> Iterator[str]:
    failed = tables.failures(campaign)
    whole = campaign.study.count
    kind = "failure" if failed.rows else "good" if campaign.count == whole else "warning"
    text = f"{campaign.count} of {whole} runs" + (f", {len(failed.rows)} failed" if failed.rows else "")
    yield f'<h1>Campaign: {escaped(name)} <span class="badge {kind}">{escaped(text)}</span></h1>'
    yield f'<p class="where">{escaped(str(campaign.folder))}</p>'
    yield from table(tables.summary(campaign))
    if not campaign.count:
        yield "<p>No run has ended yet.</p>"
        return
    yield from table(tables.metrics(campaign))
    if (best := tables.best(campaign)).rows:
        yield from table(best)
    for metric in campaign.study.metrics:
        drawn = [*curves(campaign, metric.name), *heat_maps(campaign, metric.name)]
        if drawn:
            yield f"<h2>Figures of {escaped(metric.name)}</h2>"
            yield '<div class="figures">'
            yield from (_drawn(figure, caption) for caption, figure in drawn)
            yield "</div>"
    for one in (*tables.sensitivity(campaign), *tables.far(campaign), tables.findings(campaign), failed):
        if one.rows:
            yield from table(one)


def _drawn(figure: Figure, caption: str) -> str:
    written = BytesIO()
    figure.savefig(written, format="svg", metadata={"Date": None})
    return image(written.getvalue(), "svg+xml", caption)
