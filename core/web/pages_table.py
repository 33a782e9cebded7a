"""Which path of the household's pages is answered by what. The API has a table of its own, which is described."""

from typing import Final

from core.web import (
    pages,
    pages_assertions,
    pages_imports,
    pages_plans,
    pages_transactions,
    pages_wishes,
    static,
)
from core.web.asking import Routes

PAGES: Final[Routes] = {
    "/": {"GET": pages.overview},
    "/register": {"GET": pages.register},
    "/accounts": {"GET": pages.accounts, "POST": pages_wishes.add_account},
    "/accounts/{id}/balance": {"POST": pages_assertions.say_balance},
    "/accounts/{id}/close": {"POST": pages_wishes.shut_account},
    "/entries": {"POST": pages_wishes.write_entry},
    "/entries/{id}": {"GET": pages.entry, "POST": pages_wishes.change_entry},
    "/entries/{id}/delete": {"POST": pages_wishes.delete_entry},
    "/transactions": {"POST": pages_transactions.write_transaction},
    "/transactions/new": {"GET": pages_transactions.new_transaction},
    "/transactions/{id}": {"GET": pages_transactions.transaction},
    "/transactions/{id}/reverse": {"POST": pages_transactions.reverse},
    "/transactions/{id}/post": {"POST": pages_transactions.post},
    "/transactions/{id}/void": {"POST": pages_transactions.void},
    "/plans": {"GET": pages_plans.plans},
    "/plans/budgets": {"POST": pages_plans.budget},
    "/plans/recurring": {"POST": pages_plans.recurring},
    "/plans/recurring/{id}": {"GET": pages_plans.one_recurring},
    "/plans/recurring/{id}/end": {"POST": pages_plans.end_recurring},
    "/import": {"GET": pages_imports.imports},
    "/import/{id}": {"GET": pages_imports.one_import},
    "/start": {"POST": pages_wishes.start},
    "/language": {"POST": pages_wishes.choose_language},
    "/static/{folder}/{name}": {"GET": static.asset},
}
